"""How alike devices are, over the configurations that both measured."""

import math
from dataclasses import replace
from datetime import date
from typing import Any

import pytest
from scipy import stats

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from crowd.results.reading import selectors
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.transferring import correlations
from tests.builders.crowds import Join, send
from tests.builders.documents import front_document, predict, session_document
from tests.builders.measuring import in_balanced_order

NAMES = ("best", "accurate", "third", "fourth", "fifth")
TIMES = dict(zip(("default", *NAMES), (80_000, 10_000, 90_000, 40_000, 20_000, 30_000), strict=True))


@pytest.fixture
def wide(pack: dict[str, Any], db: None) -> FrontVersion:
    """A front with a default and five other configurations."""
    document = front_document(pack, version="wide")
    extra = document["configurations"][-1]
    for number, name in enumerate(NAMES[2:]):
        point = extra | {"name": name, "parameters": extra["parameters"] | {"integration_rate": 3 + number}}
        predict(point, runtime=0.02)
        document["configurations"].append(point)
    return publish_content(document)[0]


def measure_all(join: Join, model: str, times: dict[str, int]) -> None:
    send(join(), session_document("kfusion-wide", runs=in_balanced_order(times)), device=model)


def test_two_devices_are_compared_over_what_both_measured(wide: FrontVersion, join: Join) -> None:
    fast = TIMES
    slow = dict(zip(("default", *NAMES), (300_000, 50_000, 260_000, 200_000, 50_500, 90_000), strict=True))
    measure_all(join, "Pixel 8", fast)
    measure_all(join, "Pixel 9", slow)

    (pair,) = correlations.device_correlations(["google-pixel-8", "google-pixel-9"])

    logs = [[math.log(times[name]) for name in fast] for times in (fast, slow)]
    assert (pair.front, pair.configurations) == (wide.slug, 6)
    assert pair.pearson.value == pytest.approx(stats.pearsonr(*logs).statistic)
    assert pair.spearman.value == pytest.approx(stats.spearmanr(*logs).statistic)
    assert pair.pearson.low < pair.pearson.value < pair.pearson.high


def test_too_few_common_configurations_say_nothing(wide: FrontVersion, join: Join) -> None:
    measure_all(join, "Pixel 8", {"default": 80_000, "best": 10_000, "accurate": 90_000})
    measure_all(join, "Pixel 9", {"default": 90_000, "best": 12_000, "accurate": 95_000})

    assert correlations.device_correlations(["google-pixel-8", "google-pixel-9"]) == ()


def test_a_period_of_all_days_says_what_all_days_say(wide: FrontVersion, join: Join) -> None:
    every, none = SpeedupFilters(since=date(2000, 1, 1)), SpeedupFilters(until=date(2000, 1, 1))
    times = {"default": 80_000, "best": 10_000, "accurate": 90_000, "third": 9_000}
    for count, model in enumerate(("Pixel 8", "Pixel 9"), 1):
        measure_all(join, model, {name: count * frame_us for name, frame_us in times.items()})

        winners = selectors.winners(every)

        assert replace(winners, filters=SpeedupFilters()) == selectors.winners(SpeedupFilters())
        assert [row.winner for row in winners.rows] == ["third"] * count
    assert correlations.correlation_matrix(every).pearson[0, 1] == pytest.approx(1.0)
    assert selectors.winners(none).rows == ()


def test_compare_tells_the_correlations(wide: FrontVersion, join: Join) -> None:
    measure_all(join, "Pixel 8", TIMES)
    measure_all(join, "Pixel 9", {name: 2 * frame_us for name, frame_us in TIMES.items()})

    answer = join().get("/compare?devices=google-pixel-8,google-pixel-9").json()

    (row,) = answer["correlations"]
    assert row["devices"] == ["google-pixel-8", "google-pixel-9"]
    assert row["spearman"]["value"] == pytest.approx(1.0)
    assert row["pearson"]["low"] < 1.0
