"""How well each way of predicting does on measured devices: errors, intervals and the regret of its advice.

A device is predicted from what devices of other families taught. It first gives its session (default and
best, with their stages), then three probes. Values are logarithms of ratios, as in `pareto.devices`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pareto.devices import probes
from pareto.devices.device_map import SEPARATOR, DeviceMap
from pareto.devices.ladder import FOLDS, LEAST_RESIDUALS, LEAST_SCALE, QUANTILE_95
from pareto.devices.prediction import Belief, Observation
from pareto.devices.rungs import LEAST_ERROR, RUNGS

Array = NDArray[np.float64]

BEST = "best"
PROBES, SEEDS = 3, 10
# Of what is recommended: by the rule, and of what is fastest by the mean; among points, and among all.
REGRETS = ("regret", "fastest", "any", "any_fastest")
MOST_LISTED = 20  # devices that get a line each
ALONE, SESSION, CHOSEN, RANDOM = "best alone", "session", "3 chosen probes", "3 random probes"


@dataclass(frozen=True)
class Target:
    """A device to predict: what it measured (`row`, with `errors`) of the quantities of `reference`."""

    name: str
    family: str
    reference: Array
    row: Array
    errors: Array
    names: tuple[str, ...]

    @property
    def whole(self) -> list[int]:
        """The places of configurations."""
        return [place for place, name in enumerate(self.names) if SEPARATOR not in name]

    @property
    def others(self) -> list[int]:
        """Those that it measured besides best."""
        return [p for p in self.whole if self.names[p] != BEST and not np.isnan(self.row[p])]

    @property
    def best(self) -> int:
        return self.names.index(BEST)

    def allowed(self, names: Collection[str]) -> list[int]:
        """The places of those of `names` that it measured."""
        return [place for place in (*self.others, self.best) if self.names[place] in names]

    def regret_of(self, chosen: int, names: Collection[str]) -> float:
        """By which part the configuration at the place `chosen` is slower than the fastest of `names`."""
        return float(np.expm1(self.row[self.allowed(names)].max() - self.row[chosen]))

    def seen(self, measured: Sequence[int], stages: bool = True) -> Observation:
        """Its session, with `stages` or without, and the configurations at the places `measured`."""
        stage_places = [
            p for p, name in enumerate(self.names) if SEPARATOR in name and not np.isnan(self.row[p])
        ]
        places = np.array([self.best, *(stage_places if stages else []), *measured])
        return Observation(places, self.row[places], np.maximum(self.errors[places], LEAST_ERROR))


@dataclass(frozen=True)
class Prediction:
    """What one way says of a target `after` it measured the configurations at the places `measured`."""

    target: Target
    way: str
    after: str
    measured: tuple[int, ...]
    mean: Array
    deviation: Array

    @property
    def tested(self) -> list[int]:
        return [place for place in self.target.others if place not in self.measured]

    @property
    def error(self) -> float:
        """The median relative error of ratios that were not measured."""
        left = self.mean[self.tested] - self.target.row[self.tested]
        return float(np.median(np.abs(np.expm1(left))))

    @property
    def standardised(self) -> Array:
        left = self.mean[self.tested] - self.target.row[self.tested]
        return np.abs(left) / np.maximum(self.deviation[self.tested], 1e-9)

    def regret(self, allowed: Collection[str], scale: float) -> float:
        """By which part the recommended one of `allowed` is slower than the fastest of them that was
        measured.

        The rule of `crowd.predictions.recommendations.recommend`: best, unless the fastest wins by its
        interval, which is `scale` times as wide as believed.
        """
        target = self.target
        measured = {target.best, *self.measured}
        places = target.allowed(allowed)
        expected = {place: float((target.row if place in measured else self.mean)[place]) for place in places}
        fastest = max(places, key=expected.__getitem__)
        half = 0.0 if fastest in measured else QUANTILE_95 * scale * self.deviation[fastest]
        chosen = fastest if expected[fastest] - half > target.row[target.best] else target.best
        return target.regret_of(chosen, allowed)


Way = Callable[[Target, Sequence[int]], Belief]


def predictions(device_map: DeviceMap, least: int, rungs: Iterable[str] = RUNGS) -> Iterator[Prediction]:
    """Those of every way for each device with `least` configurations or more besides its session."""
    families = sorted(device_map.families.unique())
    for fold in range(min(FOLDS, len(families))):
        left_out = families[fold::FOLDS]
        others = device_map.without_families(left_out)
        beliefs = {rung: RUNGS[rung](others) for rung in rungs}
        for target in _targets(device_map.of(device_map.ratios.index[device_map.families.isin(left_out)])):
            if len(target.others) < least:
                continue
            for way, predict in BASELINES.items():
                yield from _one_way(way, predict, target, None)
            for rung, belief in beliefs.items():
                yield from _one_way(rung, _updated(belief), target, belief)


def _targets(device_map: DeviceMap) -> Iterator[Target]:
    reference, names = device_map.reference.to_numpy(float), tuple(device_map.ratios.columns)
    for device, row in device_map.ratios.iterrows():
        errors = device_map.errors.loc[device].to_numpy(float)
        yield Target(str(device), device_map.families[device], reference, row.to_numpy(float), errors, names)


def _one_way(way: str, predict: Way, target: Target, belief: Belief | None) -> Iterator[Prediction]:
    def made(after: str, measured: Sequence[int]) -> Prediction:
        predicted = predict(target, measured)
        return Prediction(target, way, after, tuple(measured), predicted.mean, predicted.deviation)

    if belief is not None:
        alone = belief.after(target.seen((), stages=False))
        yield Prediction(target, way, ALONE, (), alone.mean, alone.deviation)
    yield made(SESSION, ())
    if way == "reference":
        return
    if belief is not None:
        begun = predict(target, ())
        chosen = probes.choose(begun, [], target.others, target.whole, PROBES, seed=0)
        yield made(CHOSEN, [one.place for one in chosen])
    for seed in range(SEEDS):
        yield made(RANDOM, np.random.default_rng(seed).choice(target.others, PROBES, replace=False).tolist())


def _updated(belief: Belief) -> Way:
    return lambda target, measured: belief.after(target.seen(measured))


def _certain(mean: Array) -> Belief:
    return Belief(mean, np.zeros((len(mean), len(mean))))


def _factor(target: Target, measured: Sequence[int]) -> Belief:
    """The reference's ratios times the factor that what was measured shows on average."""
    places = [target.best, *measured]
    return _certain(target.reference + float(np.mean(target.row[places] - target.reference[places])))


def _exponent(target: Target, measured: Sequence[int]) -> Belief:
    """The reference's ratios to the power that suits what was measured: a line through the default."""
    places = [target.best, *measured]
    x, y = target.reference[places], target.row[places]
    return _certain(target.reference * (float(x @ y) / float(x @ x)))


BASELINES: dict[str, Way] = {
    "reference": lambda target, _: _certain(target.reference),
    "factor": _factor,
    "exponent": _exponent,
}


def report(made: Sequence[Prediction], points: Collection[str], others: Collection[str]) -> str:
    """`made` as Markdown tables. `points` may be recommended, and `others` in the last columns."""
    ways = dict.fromkeys(one.way for one in made)
    families = {one.target.family for one in made}
    scales = {(way, family): _scale(made, way, family) for way in ways for family in families}
    lines = pd.DataFrame([_line(one, scales[one.way, one.target.family], points, others) for one in made])
    each = lines.groupby(["way", "after", "device"], sort=False).mean()
    table = ["| way | after | error | worst device | in 95 % | widened | regret | fastest | any | fastest |"]
    table.append("|---|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    for (way, after), rows in each.groupby(["way", "after"], sort=False):
        mean = rows.mean()
        inside = ["-", "-"] if way in BASELINES else [_percent(mean.within), _percent(mean.widened)]
        regrets = [_percent(mean[name]) for name in REGRETS]
        cells = [way, after, f"{mean.error:.3f}", f"{rows.error.max():.3f}", *inside, *regrets]
        table.append(f"| {' | '.join(cells)} |")
    targets = {one.target.name: one.target for one in made}.values()
    best = [
        _percent(float(np.mean([target.regret_of(target.best, names) for target in targets])))
        for names in (points, {*points, *others})
    ]
    sections = ["\n".join(table), f"The published best: {best[0]} among points, {best[1]} among all."]
    return "\n\n".join([*sections, *([_by_device(each, ways)] if len(targets) <= MOST_LISTED else [])])


def _by_device(each: pd.DataFrame, ways: Iterable[str]) -> str:
    """Errors after a session, a line for each device."""
    errors = each.xs(SESSION, level="after").error.unstack("way")[list(ways)]
    table = [f"| device | {' | '.join(ways)} |", f"|---|{'--:|' * len(errors.columns)}"]
    table += [
        f"| {device} | {' | '.join(f'{value:.3f}' for value in row)} |" for device, row in errors.iterrows()
    ]
    return "\n".join(table)


def _scale(made: Iterable[Prediction], way: str, family: str) -> float:
    """How much wider intervals must be, as the families besides `family` show (`pareto.devices.ladder`)."""
    others = [
        one.standardised
        for one in made
        if one.way == way and one.after == SESSION and one.target.family != family
    ]
    values = np.concatenate(others) if others else np.array([])
    if way in BASELINES or len(values) < LEAST_RESIDUALS:
        return 1.0
    return max(LEAST_SCALE, float(np.quantile(values, 0.95)) / QUANTILE_95)


def _line(
    one: Prediction, scale: float, points: Collection[str], others: Collection[str]
) -> dict[str, object]:
    values = {
        "way": one.way,
        "after": one.after,
        "device": one.target.name,
        "error": one.error,
        "within": (one.standardised < QUANTILE_95).mean(),
        "widened": (one.standardised < QUANTILE_95 * scale).mean(),
    }
    everything = {*points, *others}
    each = ((points, scale), (points, 0.0), (everything, scale), (everything, 0.0))
    return values | {name: one.regret(*asked) for name, asked in zip(REGRETS, each, strict=True)}


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
