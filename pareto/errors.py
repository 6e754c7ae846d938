"""What can go wrong in an exploration; every error names the bad value and what would be right."""


class ParetoError(ValueError):
    """The root of every error this package raises on purpose."""


class SpaceError(ParetoError):
    """A space, or the file that describes it, is not well formed."""


class ConstraintError(SpaceError):
    """A constraint cannot be read, or forbids what must be allowed."""


class ConfigurationError(ParetoError):
    """A configuration does not lie in its space."""


class ForbiddenError(ConfigurationError):
    """A configuration of the space breaks one of its constraints."""


class ObjectiveError(ParetoError):
    """Objectives, their limits or their measured values are not what the exploration expects."""


class MethodError(ParetoError):
    """There is no such search method, or it does not take the option, seed or count given to it."""


class StateError(ParetoError):
    """A saved state belongs to another space or was written by an incompatible version."""


class DamagedStateError(StateError):
    """A saved state cannot be read; the measurements beside it may still be."""


class ScenarioError(ParetoError):
    """A scenario file lacks something, or asks for something that is not supported."""


class EvaluationError(ParetoError):
    """One configuration could not be measured; the message is the reason kept beside it."""


class InfeasibleError(EvaluationError):
    """A configuration was measured, and the answer is that it does not count."""


class NoAnswerError(ParetoError):
    """An exploration cannot give the answer asked for yet; it can go on all the same."""


class NothingMeasuredError(NoAnswerError):
    """Nothing was told yet."""


class AllFailedError(NoAnswerError):
    """Every configuration that was tried failed."""


class NothingFeasibleError(NoAnswerError):
    """No measured configuration keeps the limits."""


class ConstantObjectiveError(NoAnswerError):
    """No objective differs between configurations, so that none is better than another."""
