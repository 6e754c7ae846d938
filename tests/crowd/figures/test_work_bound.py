"""Speedups that the work of a configuration allows: no confirmation lifts a figure beyond them."""

import csv
import json
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from django.conf import LazySettings

from crowd.fronts.content import plans
from crowd.fronts.publishing.services import publish_content
from crowd.results.figures import plausible
from crowd.results.figures.plausible import possible_range
from crowd.results.models import SessionSummary
from slam.kfusion.work import LOG_WORK_MARGIN, work_range
from tests.builders.crowds import Join, send
from tests.builders.documents import session_document
from tests.builders.known_front import FILE, known_front
from tests.builders.measuring import in_balanced_order
from tests.builders.rows import front_of
from wire.front import DEFAULT, Front

ROOT = Path(__file__).parents[3]
FRONTS = sorted((ROOT / "fixtures" / "fronts").glob("*.json"))
DEVICES = ROOT / "docs" / "research" / "device-map.csv"
MARGIN = math.exp(LOG_WORK_MARGIN)
# A default that spends its time on tracking, of which `best` may save the most.
TRACKING = {"preprocessing": 0.01, "tracking": 0.85, "integration": 0.03, "raycasting": 0.1}
# Seconds a frame by stage, and "frame".
Times = Mapping[str, float]


@pytest.fixture(autouse=True)
def sequences(settings: LazySettings) -> None:
    settings.FRONTRUNNER_SEQUENCES = [ROOT / "fixtures" / "sequences"]


def shipped(path: Path) -> Front:
    return front_of(known_front() if path == FILE else json.loads(path.read_text()))


def times_of(front: Front) -> dict[str, Times]:
    """What the reference device of `front` measured on the clients' sequence, over the default's time."""
    times = {
        point.name: msgspec.to_builtins(point.predicted.on_sequence)
        for point in (*front.points, *front.probes)
        if point.predicted.on_sequence is not None
    }
    return {name: one["stages"] | {"frame": one["runtime_ratio"]} for name, one in times.items()}


def assert_inside(front: Front, times: Mapping[str, Times]) -> None:
    """Each stage time and each speedup of `times`, by configuration, is one that the work allows."""
    for point in (*front.points, *front.probes):
        if point.name not in times:
            continue
        default, own = times[DEFAULT], times[point.name]
        ratios = plans.stage_ratios(front, point)
        assert ratios is not None
        for stage in own.keys() - {"frame"}:
            low, high = ratios[stage]
            assert low / MARGIN <= default[stage] / own[stage] <= high * MARGIN, (point.name, stage)
        low, high = possible_range(front, point)
        assert low < math.log(default["frame"] / own["frame"]) < high, point.name


@pytest.mark.slow
@pytest.mark.parametrize("path", FRONTS, ids=lambda path: path.stem)
def test_every_stage_time_of_every_shipped_front_lies_inside(path: Path) -> None:
    front = shipped(path)
    times = times_of(front)

    assert len(times) == len(front.points) + len(front.probes)
    assert_inside(front, times)


def test_every_stage_time_of_every_measured_device_lies_inside() -> None:
    """Sixteen devices, four of them browsers' drivers without stage times. They ran 40 frames."""
    front = shipped(FILE)
    protocol = msgspec.structs.replace(front.protocol, frames=40)
    content = msgspec.structs.replace(front.content, protocol=protocol)
    front = replace(front, content=content)
    devices: dict[str, dict[str, Times]] = defaultdict(dict)
    for row in csv.DictReader(DEVICES.read_text().splitlines()):
        stages = {stage: float(row[stage]) for stage in plans.stage_ratios(front, front.points[0]) or {}
                  if row.get(stage)}  # fmt: skip
        devices[row["device"]][row["configuration"]] = stages | {"frame": float(row["seconds"])}

    assert len(devices) == 16
    for times in devices.values():
        assert_inside(front, times)


def test_the_bound_of_a_configuration_is_near_what_devices_reach() -> None:
    """Devices reach 19.8 with `best`. Without the shares of stages it would be 140."""
    front = shipped(FILE)
    best = front.point("best")
    assert best is not None

    low, high = map(math.exp, possible_range(front, best))

    assert (low, high) == (pytest.approx(0.5), pytest.approx(36.7, abs=0.1))


def test_the_default_is_about_as_fast_as_itself() -> None:
    front = shipped(FILE)

    low, high = map(math.exp, possible_range(front, front.points[0]))

    assert 0.5 <= low < 1 < high < 2


def test_the_rest_of_the_default_s_time_goes_to_the_stages_that_gain_most() -> None:
    ratios = {"slow": (1.0, 2.0), "fast": (4.0, 10.0)}

    narrow = work_range(ratios, {"slow": (0.4, 0.6), "fast": (0.2, 0.5)})
    unknown = work_range(ratios, {})

    assert tuple(map(math.exp, narrow)) == (pytest.approx(0.5), pytest.approx(1 / (0.5 / 10 + 0.5 / 2)))
    assert math.exp(unknown[1]) == pytest.approx(10)


def test_a_stage_that_is_never_run_bounds_nothing() -> None:
    low, high = work_range({"skipped": (math.inf, math.inf), "never before": (0.0, 0.0)}, {})

    assert (low, high) == (-math.inf, math.inf)


def measure_best(join: Join, model: str, *speedups: float, shares: Mapping[str, float] | None = None) -> None:
    """Sessions of kfusion-4, each from its own network, in which best gains one of `speedups`."""
    default_us = 400_000
    stages = None if shares is None else {s: [int(default_us * share)] * 100 for s, share in shares.items()}
    for speedup in speedups:
        runs = in_balanced_order({"default": default_us, "best": round(default_us / speedup)})
        for run in runs:
            run["stages_us"] = stages if run["configuration"] == "default" else None
        send(join(), session_document("kfusion-4", runs=runs), device=model)


def reasons(model: str) -> list[str]:
    rows = SessionSummary.objects.filter(cohort__device__name=model).order_by("session_id")
    return list(rows.values_list("reason", flat=True))


@pytest.fixture
def published(db: None, settings: LazySettings) -> None:
    """kfusion-4 with two pairs a session, so that sessions are small."""
    settings.FRONTRUNNER_QUORUM = 3
    document = known_front()
    document["protocol"]["repeats"] = 2
    publish_content(document)


@pytest.mark.slow
def test_no_confirmation_lifts_a_figure_beyond_the_work(published: None, join: Join) -> None:
    """The bound is 36.7. The reach, four times the prediction, would be 39 and more once others confirm."""
    for _ in range(3):
        measure_best(join, "Pixel 8", 38.0)
        measure_best(join, "Pixel 9", 35.0)

    assert reasons("Pixel 8") == ["impossible_speedup"] * 3
    assert reasons("Pixel 9") == [""] * 3


@pytest.mark.slow
def test_what_is_possible_knows_the_stages_of_confirmed_models(published: None, join: Join) -> None:
    measure_best(join, "Pixel 9", 30.0, 30.0, 30.0, shares=TRACKING)
    measure_best(join, "Pixel 8", 38.0)

    assert reasons("Pixel 9") == [""] * 3
    assert reasons("Pixel 8") == [""]


@pytest.mark.slow
def test_of_many_confirmed_models_the_first_ones_are_read(
    published: None, join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plausible, "MOST_MODELS", 1)
    measure_best(join, "Pixel 7", 20.0, 20.0, 20.0)
    measure_best(join, "Pixel 9", 30.0, 30.0, 30.0, shares=TRACKING)
    measure_best(join, "Pixel 8", 38.0)

    assert reasons("Pixel 9") == [""] * 3
    assert reasons("Pixel 8") == ["impossible_speedup"]
