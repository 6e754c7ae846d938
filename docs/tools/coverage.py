"""Prints the tables of docs/research/coverage.md that rest on simulations: python -m docs.tools.coverage"""

import math
from collections.abc import Callable, Iterable

import numpy as np

from tests.crowd import test_headline as headline
from tests.crowd import test_statistics as models
from tests.wire import test_session_statistics as sessions
from wire.session_statistics import speedup

SESSIONS, CROWDS = 20_000, 4_000


def table(title: str, columns: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    """Print a table in Markdown."""
    names = list(columns)
    print(f"\n{title}\n")
    for row in (names, ["---"] * len(names), *rows):
        print("| " + " | ".join(row) + " |")


def percent(share: float) -> str:
    return f"{round(100 * share, 1) + 0.0:.1f} %"


def session_rows() -> Iterable[list[str]]:
    truth = math.log(sessions.SECONDS["default"] / sessions.SECONDS["best"])
    for name, trace in sessions.TRACES.items():
        found = sessions.log_ratios(trace, SESSIONS)
        errors = np.mean(found, axis=1) - truth
        speedups = [one for logs in found if (one := speedup(logs))]
        intervals = [one.interval or (math.inf, 0.0) for one in speedups]
        yield [
            name.replace("%", " %"),
            percent(float(np.mean([one.changed for one in speedups]))),
            percent(math.expm1(float(np.abs(errors).mean()))),
            percent(math.expm1(float(errors.mean()))),
            percent(float(np.mean([low <= truth <= high for low, high in intervals]))),
        ]


def model_rows() -> Iterable[list[str]]:
    for people, each in ((3, 1), (3, 20), (5, 5), (10, 3), (20, 3)):
        covered = (models.coverage(people, each, *noise) for noise in models.NOISE)
        yield [f"{people}, {each}", *map(percent, covered)]


def hostile_rows() -> Iterable[list[str]]:
    for noise in (0.03, 0.05, 0.10, 0.15):
        honest = np.random.default_rng(5).normal(0.0, noise, (4_000, 3))
        yield [f"{noise:.2f}", percent(math.expm1(float(models.hostile_move(honest).mean())))]


def headline_rows(coverage: Callable[..., float]) -> Iterable[list[str]]:
    for name, population in headline.POPULATIONS.items():
        yield [name, *(percent(coverage(population, size, crowds=CROWDS)) for size in headline.SIZES)]


def invented_rows() -> Iterable[list[str]]:
    for times in (1.6, 2.4, 55):
        shifts = (headline.shift(10, between, math.log(times)) for between in (0.05, 0.15, 0.4))
        yield [str(times), *map(percent, shifts)]


def main() -> None:
    crowds = ("models", *(f"{size} measured" for size in headline.SIZES))
    table("Sessions", ("what happens", "set aside", "error", "bias", "interval covers"), session_rows())
    table("A model", ("units, sessions each", *map(str, models.NOISE)), model_rows())
    table("One hostile unit in four", ("noise between units", "Huber"), hostile_rows())
    table("The models measured", crowds, headline_rows(headline.measured_coverage))
    table("All models", crowds, headline_rows(headline.population_coverage))
    table("One invented model in ten", ("times the truth", "0.05", "0.15", "0.40"), invented_rows())


if __name__ == "__main__":
    main()
