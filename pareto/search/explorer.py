"""The ask-and-tell interface: which configurations to measure next, and their results."""

from __future__ import annotations

import operator
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pareto.errors import (
    ConfigurationError,
    DamagedStateError,
    MethodError,
    ObjectiveError,
    SpaceError,
    StateError,
)
from pareto.fronts.censored import Censored
from pareto.fronts.objective import (
    Objective,
    read_limits,
    read_number,
    read_objectives,
    read_value,
    read_values,
)
from pareto.search.answer import obstacle
from pareto.search.history import History
from pareto.search.methods import DEFAULT, METHODS, create
from pareto.search.predicted_front import TREES, predict_front
from pareto.search.prior import Prior
from pareto.search.recommendation import Estimates, Recommended, estimate, recommend
from pareto.search.stopping import Condition, Stop, find_stop, stop_conditions
from pareto.spaces.grid import Indices
from pareto.spaces.space import Configuration, Space, read_index

if TYPE_CHECKING:
    from pandas import DataFrame

NOTHING: Mapping[str, float] = MappingProxyType({})
VERSION = 1  # of the saved state


@dataclass(frozen=True)
class Proposal:
    """A configuration to measure, and the phase that proposed it: random, active, again or repeat.

    `again`: the search measures a configuration once more; `repeat`: the user asked for it.
    """

    index: int
    configuration: Configuration
    phase: str
    _explorer: Explorer = field(repr=False, compare=False)

    def report(self, bounds: Mapping[str, float], estimates: Mapping[str, float] = NOTHING) -> Stop | None:
        """Return a reason to end this measurement now, with the values to tell, or None.

        Report what is known so far of any objectives: `bounds` are values that the final ones will reach or
        exceed (fall below, where they are maximised), such as the largest error so far; `estimates` are
        expected final values, at most 5 % wrong, such as the mean time of a step. A measurement ends where
        these break a limit, or where a finished point is better in all objectives by more than the noise. The
        default, and what is measured again, are never ended.

        Raises ObjectiveError for a name that is not an objective, or a value that is not a finite number.
        """
        conditions = self._explorer.stop_conditions(self.configuration)
        return find_stop(self._explorer.objectives, conditions, bounds, estimates)


class Explorer:
    """Searches `space` for the non-dominated configurations.

    `objectives` are names (minimised) or Objective; `limits` bound them inclusively, from above or, for
    maximised ones, from below. On one machine, equal seeds, options and histories give equal proposals;
    another one may round otherwise. Further `options` are the method's; `pareto.search.methods` lists both.

    `prior` is what another device measured, as (configuration, values or None for a failure) pairs: it guides
    the search as far as the measurements here confirm it, and never counts as measured. Pass measurements of
    this device to `tell` instead. A Censored value of a prior counts as its bound, and its configuration is
    not tried first.

    A search learns its noise from a few early repeats; see `propose`. They are left out with a `budget` below
    15 measurements, and with `rounds`: measurements of one configuration from elsewhere, which tell the noise
    and count for nothing else.

    Raises SpaceError, ObjectiveError, or MethodError for an unknown method, option or seed, or for a method
    that cannot use a prior.
    """

    def __init__(
        self,
        space: Space,
        objectives: Iterable[str | Objective],
        limits: Mapping[str, float] | None = None,
        *,
        seed: int = 0,
        method: str = DEFAULT,
        prior: Iterable[tuple[Mapping[str, Any], Mapping[str, float] | None]] = (),
        budget: int | None = None,
        rounds: Iterable[Mapping[str, float]] | None = None,
        **options: Any,
    ) -> None:
        if not isinstance(space, Space):
            raise SpaceError(f"an explorer needs a Space, not {space!r}: Space.load reads one from a file")
        self.space = space
        self.objectives = read_objectives(objectives)
        self.limits = read_limits(self.objectives, limits)
        self.seed = _whole("seed", seed)
        self.finished = False
        self.history = History(space, self.objectives, self.limits)
        # JSON cannot encode NumPy's integers.
        options = {k: int(v) if isinstance(v, np.integer) else v for k, v in options.items()}
        self.method, self._options = method, options
        self._method = create(self.method, self._options)
        self._method.seed = self.seed % 2**64
        self.budget = None if budget is None else _whole("budget", budget)
        if rounds is not None:
            self.history.rounds = [read_values(self.objectives, values) for values in rounds]
        self._take_prior(Prior.read(space, self.objectives, self.limits, prior))
        self._asks = 0
        self._estimates: tuple[int, Estimates] | None = None  # of so many measurements
        self._conditions: tuple[int, list[Condition]] | None = None  # likewise

    def ask(self, count: int = 1, repeats: bool = False) -> list[Configuration]:
        """Return up to `count` configurations to measure; see `propose`."""
        return [proposal.configuration for proposal in self.propose(count, repeats)]

    def propose(self, count: int = 1, repeats: bool = False) -> list[Proposal]:
        """Return up to `count` proposals, none of them pending, and mark them pending.

        They are distinct and without results, except those of phase `again`. The eighth measurement is the
        default again, also within one batch. Where repeats agree to the last digit, one more follows.
        Otherwise three do, and then each that is worth more than a new configuration. With `repeats`,
        configurations of the current front are proposed again, those measured least first. Fewer than `count`
        come back when the method waits for pending results, or has nothing more to propose; then `finished`
        is set until the next `tell`.

        Raises MethodError when `count` is not a whole number.
        """
        count = _whole("count", count)
        rng = np.random.default_rng([self.seed % 2**64, self._asks])
        self._asks += 1
        if count <= 0:
            return []
        if repeats:
            chosen = self._repeats(count)
        else:
            self._method.budget = self.budget
            chosen = self._method.propose(self.history, count, rng)
            self.finished = not chosen and not self.history.pending
        for index, phase in chosen:
            self.history.expect(index, phase)
        return [Proposal(index, self.space.decode(index), phase, self) for index, phase in chosen]

    def tell(
        self,
        configurations: Sequence[Mapping[str, Any]],
        results: Sequence[Mapping[str, float] | None],
        phase: str = "told",
    ) -> None:
        """Record measured values; None is a failed measurement, from which the search also learns.

        Accepts any subset of the proposals, in any order, and configurations that were never proposed, for
        which `phase` is recorded. Values of one configuration are averaged. Either all are recorded or, when
        an error is raised (ConfigurationError, ObjectiveError), none.

        A value may be Censored: this or worse. Its configuration is never on the front, and the models learn
        what they expect of it beyond the bound.
        """
        if not (_is_list(configurations) and _is_list(results)):
            raise ConfigurationError("tell takes two lists: tell([configuration], [values])")
        if len(configurations) != len(results):
            raise ObjectiveError(
                f"{len(results)} results for {len(configurations)} configurations: tell one each, "
                "None for what failed"
            )
        read = [
            (
                self.space.encode(configuration),
                None if values is None else read_values(self.objectives, values),
            )
            for configuration, values in zip(configurations, results, strict=True)
        ]
        for index, values in read:
            self.history.record(index, values, phase)
            self.finished = False

    def tell_frame(self, frame: DataFrame) -> None:
        """Record the rows of a pandas DataFrame with a column per parameter and objective, as `tell` does.

        A missing value is a failed measurement, except in a parameter that is inactive. A column `censored`
        names the objectives of a row whose value is a bound, separated by commas. Further columns are
        ignored.

        Raises ConfigurationError or ObjectiveError, and records nothing then.
        """
        from pareto.search.frames import read_frame

        rows = read_frame(frame, self.space, self.objectives)
        self.tell([configuration for configuration, _ in rows], [values for _, values in rows])

    def forget(self, configurations: Sequence[Mapping[str, Any]]) -> None:
        """Withdraw pending configurations that will not be measured; they may be proposed again.

        Raises ConfigurationError, and withdraws none then.
        """
        if not _is_list(configurations):
            raise ConfigurationError("forget takes a list: forget([configuration])")
        for index in [self.space.encode(configuration) for configuration in configurations]:
            self.history.withdraw(index)

    def recommended(self) -> list[Recommended]:
        """Return the front by posterior means, each with its configuration, values and 95 % intervals.

        Where measurements are noisy, a lucky one does not stay on it. It equals `front` where repeats agree
        or nothing was repeated. A call learns models of all measurements: it may take a second.
        """
        return recommend(self.history, self.estimates())

    def estimates(self) -> Estimates:
        """Return what to expect of every configuration that succeeded; see `recommended`."""
        measurements = self.history.measurements
        if self._estimates is None or self._estimates[0] != measurements:
            self._estimates = measurements, estimate(self.history, self._method.prior)
        return self._estimates[1]

    def stop_conditions(self, configuration: Mapping[str, Any]) -> list[Condition]:
        """Return when a measurement of `configuration` may end: once it is worse than all values of one.

        Each maps objectives to values: one to its limit, or all to those of a finished point, plus the noise.
        There are none for the default and for what was measured already: they run to their end.
        """
        index = self.space.encode(configuration)
        if index in self.history.results or index == self.space.encode(self.space.default):
            return []
        measurements = self.history.measurements
        if self._conditions is None or self._conditions[0] != measurements:
            self._conditions = measurements, stop_conditions(self.history)
        return self._conditions[1]

    def front(self) -> list[tuple[Configuration, dict[str, float]]]:
        """Return the non-dominated configurations within limits, as measured, by the first objective."""
        return self._points(*self.history.front())

    def predicted_front(self, trees: int = TREES) -> list[tuple[Configuration, dict[str, float]]]:
        """Return P, which Algorithm 1 returns as printed: what `front` would be if its forests were right.

        Random forests of `trees` trees learn from the measurements and predict the whole space; P is the
        front of that, by the first objective. Its values are predictions, and much of it may never have been
        measured. Limits do not count. Empty where nothing succeeded. Raises MethodError for a large space.
        """
        indices, values = predict_front(self.history, trees, self._method.seed)
        order = np.lexsort((values * [objective.sign for objective in self.objectives]).T[::-1])
        return self._points(indices[order], values[order])

    def front_frame(self) -> DataFrame:
        """Return `front` as a pandas DataFrame with a column for each parameter and objective."""
        from pareto.search.frames import write_frame

        return write_frame(self.space, self.objectives, self.front())

    def evaluations_frame(self) -> DataFrame:
        """Return a row for each measurement, as `front_frame` does, NaN for the values of failed ones.

        Where a value is a bound, a column `censored` names such objectives of each row, for `tell_frame`.
        Configurations stand in the order in which they first arrived, repeats of one beside each other.
        """
        from pareto.search.frames import write_frame

        names = [objective.name for objective in self.objectives]
        return write_frame(
            self.space,
            self.objectives,
            (
                (self.space.decode(index), None if row is None else dict(zip(names, row, strict=True)))
                for index, measured in self.history.results.items()
                for row in measured
            ),
        )

    def answer(self) -> list[tuple[Configuration, dict[str, float]]]:
        """Return the front if it is useful, otherwise raise the reason.

        Raises NothingMeasuredError, AllFailedError, NothingFeasibleError or ConstantObjectiveError, all of
        them NoAnswerError; `front` is empty or trivial then, and `ask` still works.
        """
        reason = obstacle(self.history)
        if reason is not None:
            raise reason
        return self.front()

    def pending(self) -> list[Configuration]:
        """Return the proposals without results, in their order."""
        return [self.space.decode(index) for index, _ in self.history.pending]

    def skip_asks(self, count: int) -> None:
        """Skip `count` batches of random numbers, so that the next ones differ."""
        self._asks += count

    def state(self) -> dict[str, Any]:
        """Return everything as plain JSON, from which `restore` continues exactly."""
        state = {
            "version": VERSION,
            "space": self.space.digest,
            "objectives": [{"name": item.name, "maximise": item.maximise} for item in self.objectives],
            "limits": self.limits,
            "seed": self.seed,
            "method": self.method,
            "options": self._options,
            "asks": self._asks,
            "finished": self.finished,
            "observations": _observations(self.history),
            "pending": [[index, phase] for index, phase in self.history.pending],
            "memory": self._method.memory(),
            "budget": self.budget,
        }
        if self._method.prior is not None:
            state["prior"] = _observations(self._method.prior.source)
        if self.history.rounds is not None:
            names = [item.name for item in self.objectives]
            state["rounds"] = [dict(zip(names, values, strict=True)) for values in self.history.rounds]
        return state

    @classmethod
    def restore(cls, space: Space, state: Mapping[str, Any]) -> Explorer:
        """Return the explorer that `state` was taken from.

        Raises StateError when it is another version's, another space's, or damaged.
        """
        if not isinstance(state, Mapping):
            raise DamagedStateError(f"the state is damaged: it is {state!r:.40}, not an object")
        if missing := [field for field in ("version", "space") if field not in state]:
            raise DamagedStateError(f"the state is damaged: {missing[0]!r} is missing")
        if state["version"] != VERSION:
            raise StateError(f"state version {state['version']!r} cannot be read: this one is {VERSION}")
        if state["space"] != space.digest:
            raise StateError(f"this state belongs to another space than {space.name!r}")
        try:
            objectives = [Objective(item["name"], item["maximise"]) for item in state["objectives"]]
            explorer = cls(
                space,
                objectives,
                state["limits"],
                seed=state["seed"],
                method=state["method"],
                budget=state.get("budget"),
                rounds=state.get("rounds"),
                **state["options"],
            )
            explorer._asks = int(state["asks"])
            if explorer._asks < 0:
                raise DamagedStateError(f"the state is damaged: it was asked {explorer._asks} times")
            explorer.finished = bool(state["finished"])
            prior = Prior(space, explorer.objectives, explorer.limits)
            _record(prior.source, state.get("prior", []))
            explorer._take_prior(prior)
            _record(explorer.history, state["observations"])
            for index, phase in state["pending"]:
                explorer.history.expect(read_index(space, index), phase)
            explorer._method.recall(state["memory"], space)
        except StateError as error:
            raise DamagedStateError(str(error)) from error
        # A list instead of an object has no `items`; an invalid value raises a ValueError.
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise DamagedStateError(f"the state is damaged: {error!r}") from error
        return explorer

    def _points(
        self, indices: Indices, values: NDArray[np.float64]
    ) -> list[tuple[Configuration, dict[str, float]]]:
        names = [objective.name for objective in self.objectives]
        return [
            (self.space.decode(int(index)), dict(zip(names, map(float, row), strict=True)))
            for index, row in zip(indices, values, strict=True)
        ]

    def _take_prior(self, prior: Prior) -> None:
        if not prior.source.results:
            return
        if not self._method.uses_prior:
            able = ", ".join(name for name, kind in METHODS.items() if kind.uses_prior)
            raise MethodError(f"method {self.method!r} cannot use a prior: {able} can")
        self._method.prior = prior

    def _repeats(self, count: int) -> list[tuple[int, str]]:
        indices, _ = self.history.front()
        waiting = self.history.waiting()
        free = [int(index) for index in indices if int(index) not in waiting]
        free.sort(key=lambda index: len(self.history.results[index]))
        return [(index, "repeat") for index in free[:count]]


def _observations(history: History) -> list[list[Any]]:
    return [
        [index, history.phases[index], [None if v is None else [*map(_saved, v)] for v in values]]
        for index, values in history.results.items()
    ]


def _saved(value: float) -> float | dict[str, float]:
    return {"censored": float(value)} if isinstance(value, Censored) else value


def _record(history: History, observations: Iterable[Sequence[Any]]) -> None:
    names = [objective.name for objective in history.objectives]
    for index, phase, measurements in observations:
        point = read_index(history.space, index)
        for values in measurements:
            read = None
            if values is not None:
                read = tuple(_read_saved(*pair) for pair in zip(names, values, strict=True))
            history.record(point, read, phase)


def _read_saved(name: str, value: Any) -> float:
    if isinstance(value, Mapping):
        return Censored(read_number(name, value["censored"]))
    return read_value(name, value)


def _is_list(items: object) -> bool:
    """Whether `items` has elements and is not a single configuration or result."""
    return isinstance(items, Collection) and not isinstance(items, (Mapping, str))


def _whole(name: str, number: Any) -> int:
    try:
        return operator.index(number)
    except TypeError:
        raise MethodError(f"{name} = {number!r} is not a whole number") from None
