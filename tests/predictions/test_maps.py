"""The nightly rebuild, and what is expected of a device by it."""

import math
from datetime import timedelta
from typing import Any

import numpy as np
import pytest
from django.utils import timezone

from crowd.fronts import selectors as fronts
from crowd.fronts.models import FrontVersion
from crowd.predictions import maps, measurements, selectors
from crowd.predictions.expectations import FrontPrediction
from crowd.predictions.models import DeviceMap
from crowd.predictions.selectors import DeviceQuery, NothingConfirmedError
from crowd.results.privacy.erasure import erase_installation
from tests.builders.measured import ADRENO, MALI, Measured

PROBES = ("probe-09", "probe-20", "probe-35")
COSTS = ("preprocessing", "tracking", "integration", "raycasting")


def different(number: int) -> dict[str, float]:
    """Costs of the stages of one device of many."""
    random = np.random.default_rng(number)
    return dict(zip(COSTS, np.exp(random.normal(1.0, 0.4, len(COSTS))), strict=True))


def ratios(expected: FrontPrediction) -> dict[str, float]:
    return {point.configuration: point.ratio for point in expected.points}


def wrong(expected: FrontPrediction, device: Measured) -> float:
    """The median error (logarithms) of what was predicted of `device`."""
    found = [
        abs(math.log(point.ratio) - device.log_ratio(point.configuration))
        for point in expected.points
        if not point.measured
    ]
    return float(np.median(found))


def wrong_by_the_reference(expected: FrontPrediction, device: Measured) -> float:
    """The same of the reference's ratios."""
    found = []
    for point in expected.points:
        if not point.measured:
            predicted = next(
                one["predicted"]["on_sequence"]
                for one in (*device.front["configurations"], *device.front["probes"])
                if one["name"] == point.configuration
            )
            found.append(abs(-math.log(predicted["runtime_ratio"]) - device.log_ratio(point.configuration)))
    return float(np.median(found))


def of(device: Measured) -> FrontPrediction:
    """What is expected of `device` now."""
    answer = selectors.predict_for_query(DeviceQuery(model=device.device), "kfusion")
    return answer.expectation


@pytest.mark.slow
def test_stage_times_predict_a_device_from_its_first_session(measured: Any) -> None:
    device = measured(costs={"raycasting": 4.0, "tracking": 1.0})

    before_any_map = of(device)
    maps.rebuild()
    after = of(device)

    assert before_any_map.rung == "reference"
    assert (after.rung, after.devices, after.sessions) == ("stages", 1, 1)
    naive = wrong_by_the_reference(after, device)
    assert wrong(after, device) < 0.5 * naive
    assert wrong(before_any_map, device) < 0.5 * naive
    assert after.seconds == pytest.approx(device.seconds("default"), rel=0.01)


def test_what_a_device_measured_is_shown_as_measured(measured: Any) -> None:
    device = measured(probes=PROBES)
    maps.rebuild()

    points = {point.configuration: point for point in of(device).points}

    assert {name for name, point in points.items() if point.measured} == {"default", "best", *PROBES}
    assert math.log(points["probe-20"].ratio) == pytest.approx(device.log_ratio("probe-20"), abs=0.01)
    assert points["best"].ate_max == pytest.approx(0.0220, abs=0.0001)  # the reference's worst
    assert points["knee"].low < points["knee"].ratio < points["knee"].high


def test_a_session_of_probes_of_two_pairs_is_valid_and_changes_no_figure_of_best(measured: Any) -> None:
    from crowd.results.models import DeviceSpeedup, State

    alone = measured("Pixel 8")
    with_probes = measured("Pixel 9", probes=PROBES)

    rows = {row.configuration.name: row for row in DeviceSpeedup.objects.filter(device__name="Pixel 9")}
    assert {row.state for row in rows.values()} == {State.VALID}
    assert set(rows) == {"best", *PROBES}
    best = DeviceSpeedup.objects.get(device__name="Pixel 8")
    assert rows["best"].speedup == best.speedup
    assert (rows["best"].sessions, rows["probe-09"].sessions) == (1, 1)
    assert alone.seconds("best") == with_probes.seconds("best")


@pytest.mark.slow
def test_the_rung_is_chosen_by_the_error_on_families_left_out(measured: Any) -> None:
    chips = (MALI, ADRENO, "PowerVR B-Series BXM-8-256", "NVIDIA GeForce RTX 3060")
    for number, chip in enumerate(chips):
        measured(f"Phone {number}", chip, costs=different(number), probes=PROBES)

    [row] = maps.rebuild()

    assert row.rung == "stages"
    assert set(row.errors) == {"power", "stages"}
    assert row.errors["stages"]["median"] < row.errors["power"]["median"]
    assert (row.errors["stages"]["families"], row.errors["stages"]["ratios"]) == (4, 12)
    assert (row.devices, row.sessions) == (4, 4)


@pytest.mark.slow
def test_erasing_an_installation_removes_its_influence(measured: Any) -> None:
    stays = measured("Pixel 8", costs=different(1), probes=PROBES)
    maps.rebuild()
    alone = bytes(DeviceMap.objects.get().belief), ratios(of(stays))
    goes = measured("Galaxy", ADRENO, costs=different(2), probes=PROBES)
    maps.rebuild()
    assert bytes(DeviceMap.objects.get().belief) != alone[0]
    assert goes.participant.delete("/me").status_code in (200, 204)

    maps.rebuild()

    assert bytes(DeviceMap.objects.get().belief) == alone[0]
    assert ratios(of(stays)) == alone[1]


@pytest.mark.slow
def test_the_last_device_of_a_group_takes_its_map_with_it(measured: Any) -> None:
    from crowd.devices.models import Installation

    measured(costs=different(1))
    maps.rebuild()
    assert DeviceMap.objects.count() == 1

    erase_installation(Installation.objects.get())
    maps.rebuild()

    assert not DeviceMap.objects.exists()


@pytest.mark.slow
def test_a_rebuild_is_due_once_a_day(measured: Any) -> None:
    assert maps.rebuild_if_due() == []
    measured()

    assert len(maps.rebuild_if_due()) == 1
    assert maps.rebuild_if_due() == []
    # A day later, and where the clock was set back since.
    for hours in (-25, 1):
        DeviceMap.objects.update(made_at=timezone.now() + timedelta(hours=hours))
        assert len(maps.rebuild_if_due()) == 1


def test_without_a_crowd_only_the_reference_has_a_figure(
    front: FrontVersion, document: dict[str, Any]
) -> None:
    with pytest.raises(NothingConfirmedError, match="no figure of kfusion-4 is confirmed yet") as error:
        selectors.predict_for_query(DeviceQuery(), "kfusion")

    answer = error.value.reference
    assert (answer.device, answer.about, answer.expectation.rung) == (
        None,
        "any device, predicted from the reference device alone",
        "reference",
    )
    assert answer.expectation.devices == 0
    [best] = [point for point in answer.expectation.points if point.configuration == "best"]
    times = document["configurations"][1]["predicted"]["on_sequence"]
    assert best.ratio == pytest.approx(1 / times["runtime_ratio"])
    assert not best.measured
    assert measurements.groups() == []
    assert fronts.key_of(front.slug) == front.pk


@pytest.mark.slow
def test_relatives_answer_for_a_device_that_nobody_measured(measured: Any, document: dict[str, Any]) -> None:
    slow = {"raycasting": 8.0, "tracking": 1.0}
    mali, adreno = ("Pixel 7", "Pixel 8", "Pixel 9"), ("Pixel 3", "Pixel 4", "Pixel 5")
    for name in mali:
        measured(name, MALI, costs=slow, probes=PROBES)
    for name in adreno:
        measured(name, ADRENO, costs={"tracking": 8.0}, probes=PROBES)
    maps.rebuild()

    answer = selectors.predict_for_query(DeviceQuery(gpu="Mali-G715"), "kfusion")

    assert answer.device is None
    assert sorted(relative.device.name for relative in answer.relatives) == sorted(mali)
    best = next(point for point in answer.expectation.points if point.configuration == "best")
    expected = Measured(measured().participant, document, "Pixel 8", MALI, slow).log_ratio("best")
    assert math.log(best.low) < expected < math.log(best.high)
    assert math.log(best.ratio) == pytest.approx(expected, abs=0.1)


@pytest.mark.slow
def test_a_map_that_cannot_be_learned_keeps_no_other_from_it(
    measured: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured()
    measured("A PC", "Intel(R) Core(TM) i7-8700 CPU")
    rebuilt = maps._rebuild_group

    def fails_on_processors(group: measurements.Group) -> DeviceMap:
        if group.processor_class == "cpu":
            raise ValueError("made up")
        return rebuilt(group)

    monkeypatch.setattr(maps, "_rebuild_group", fails_on_processors)
    assert [row.processor_class for row in maps.rebuild_if_due()] == ["gpu"]
    monkeypatch.undo()

    assert [row.processor_class for row in maps.rebuild_if_due()] == ["cpu"]
    assert maps.rebuild_if_due() == []


@pytest.mark.slow
def test_devices_that_differ_make_a_prediction_unsure(measured: Any) -> None:
    measured("Pixel 7", MALI, costs={"integration": 0.1})
    measured("Pixel 8", MALI, costs={"integration": 0.1})
    alike = selectors.predict_for_query(DeviceQuery(gpu="Mali-G715"), "kfusion").expectation
    measured("Pixel 9", MALI, costs={"raycasting": 20.0})

    different = selectors.predict_for_query(DeviceQuery(gpu="Mali-G715"), "kfusion").expectation

    def width(expected: FrontPrediction) -> float:
        [best] = [point for point in expected.points if point.configuration == "best"]
        return math.log(best.high / best.low)

    assert width(different) > 1.5 * width(alike)


def test_a_device_is_found_by_its_own_address(measured: Any) -> None:
    measured("Pixel 8")
    measured("Pixel 8 Pro")

    answer = selectors.predict_for_query(DeviceQuery(model="google-pixel-8"), "kfusion")

    assert answer.device is not None
    assert answer.device.slug == "google-pixel-8"


@pytest.mark.slow
def test_a_map_of_other_quantities_is_not_used(measured: Any) -> None:
    device = measured()
    maps.rebuild()
    DeviceMap.objects.update(quantities=["best"])

    assert of(device).rung == "reference"
