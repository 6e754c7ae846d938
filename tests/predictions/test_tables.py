"""Figures and stage times as the tables that models learn from."""

import math
from typing import Any

import numpy as np
import pytest

from crowd.fronts import selectors as fronts
from crowd.predictions import measurements, tables
from crowd.predictions.measurements import Group
from tests.builders.measured import ADRENO


def read(**changes: Any) -> tables.CrowdTable:
    [group] = measurements.groups()
    return tables.read_table(fronts.front_in_any_state(group.front_id), group, **changes)


def test_a_row_has_the_figures_and_the_stages_of_its_session(measured: Any) -> None:
    one = measured(costs={"raycasting": 5.0}, probes=["probe-20"])

    table = read()

    [row] = table.rows.index
    ratios = table.known.ratios.loc[row]
    assert ratios["best"] == pytest.approx(one.log_ratio("best"), abs=0.01)
    assert ratios["probe-20"] == pytest.approx(one.log_ratio("probe-20"), abs=0.01)
    assert math.isnan(ratios["knee"])
    stage = math.log(one.seconds("default") / one.stages("best")["raycasting"])
    assert ratios["best:raycasting"] == pytest.approx(stage, abs=0.02)
    assert table.rows.seconds[row] == pytest.approx(one.seconds("default"), rel=0.01)
    assert (table.rows.processor[row], table.known.families[row]) == ("Mali-G715", "Mali-G7")
    assert table.ate_max.loc[row, "best"] == 0.012


def test_the_reference_and_the_work_are_those_of_the_front(measured: Any, document: dict[str, Any]) -> None:
    measured()

    device_map = read().known

    [best] = [point for point in document["configurations"] if point["name"] == "best"]
    times = best["predicted"]["on_sequence"]
    assert device_map.reference["best"] == pytest.approx(-math.log(times["runtime_ratio"]))
    assert device_map.reference["best:tracking"] == pytest.approx(-math.log(times["stages"]["tracking"]))
    assert device_map.stage_times is not None
    assert device_map.stage_times.loc["best", "tracking"] == times["stages"]["tracking"]
    assert device_map.work is not None
    assert device_map.work.loc["default", ("integration", "voxels")] == pytest.approx(256**3 / 2, rel=0.01)
    assert set(device_map.work.index) == {"default", *device_map.configurations}


@pytest.mark.slow
def test_groups_keep_backends_and_classes_apart(measured: Any) -> None:
    measured()
    measured("A PC", "Intel(R) Core(TM) i7-8700 CPU")

    groups = {(group.backend, group.processor_class) for group in measurements.groups()}

    assert groups == {("opencl", "gpu"), ("opencl", "cpu")}


@pytest.mark.slow
def test_a_device_is_read_with_its_relatives_alone(measured: Any) -> None:
    measured("Pixel 8")
    measured("Pixel 7", "Mali-G710")
    measured("Galaxy", ADRENO)
    [group] = measurements.groups()

    near = tables.neighbours(group, "Mali-G715")

    assert set(read(devices=near).rows.processor) == {"Mali-G715", "Mali-G710"}


@pytest.mark.parametrize(
    ("chip", "series"),
    [
        ("Adreno 740", "Adreno 7"),
        ("Mali-G715", "Mali-G7"),
        ("NVIDIA GeForce RTX 3060", "NVIDIA GeForce RTX 3"),
        ("Apple M2", "Apple M2"),
        ("Samsung Xclipse", "Samsung Xclipse"),
        ("", ""),
    ],
)
def test_the_series_of_a_chip(chip: str, series: str) -> None:
    assert tables.chip_series(chip) == series


def test_a_distant_network_hardly_changes_the_error_of_a_figure() -> None:
    honest = [2.0, 2.03, 1.98]
    apart = measurements.robust_error([*honest, 2.47])

    assert apart < 1.2 * measurements.robust_error(honest)
    assert measurements.robust_error([1.8, 2.2, 2.0, 1.9]) > apart


def test_an_empty_group_has_an_empty_table(front: Any) -> None:
    group = Group(front.pk, "opencl", "gpu")

    table = tables.read_table(fronts.front_in_any_state(front.pk), group)

    assert table.rows.empty
    assert table.known.ratios.shape == (0, len(table.known.reference))
    assert not np.isnan(table.known.reference).any()
