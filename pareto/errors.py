"""Errors of an exploration; every message names the bad value and a remedy."""


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
    """Unknown search method, or an option, seed or count that it does not take."""


class StateError(ParetoError):
    """A saved state belongs to another space or was written by an incompatible version."""


class DamagedStateError(StateError):
    """A saved state cannot be read; the measurements may still be intact."""


class ScenarioError(ParetoError):
    """A scenario file lacks something, or asks for something that is not supported."""


class EvaluationError(ParetoError):
    """One configuration could not be measured; the message is stored as the reason."""


class InfeasibleError(EvaluationError):
    """A configuration was measured and is not feasible."""


class NoAnswerError(ParetoError):
    """An exploration has no answer yet; it can go on."""


class NothingMeasuredError(NoAnswerError):
    """Nothing was measured yet."""


class AllFailedError(NoAnswerError):
    """Every configuration that was tried failed."""


class NothingFeasibleError(NoAnswerError):
    """No measured configuration keeps the limits."""


class ConstantObjectiveError(NoAnswerError):
    """No objective differs between configurations, so none is better than another."""
