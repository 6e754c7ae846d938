"""Whether recommendations were right, and which model predicts: on the page about transfer."""

import math
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.content.judgements import Maps, judgements, maps_of
from crowd.devices.models import DeviceModel
from crowd.fronts.models import Configuration, FrontVersion
from crowd.predictions import maps
from crowd.predictions.models import DeviceMap, Recommendation
from crowd.results.models import DeviceSpeedup
from tests.builders.known_front import NAME
from tests.builders.measured import BEST_IS_BEST
from tests.dashboard.reading import read
from tests.predictions.conftest import document, front, measured

__all__ = ["document", "front", "measured"]

pytestmark = pytest.mark.django_db


def plain(client: Client, address: str) -> str:
    return read(client, address).replace("\N{NO-BREAK SPACE}", " ").replace("\N{NARROW NO-BREAK SPACE}", " ")


def recommend(name: str, log_ratio: float, half: float) -> None:
    """As if `name` had been recommended to the only device."""
    configuration = Configuration.objects.select_related("front").get(name=name, front__slug=NAME)
    Recommendation.objects.create(
        device=DeviceModel.objects.get(),
        front=configuration.front,
        backend="opencl",
        processor="Mali-G715",
        processor_class="gpu",
        configuration=configuration,
        rung="power",
        log_ratio=log_ratio,
        low=log_ratio - half,
        high=log_ratio + half,
    )


@pytest.mark.slow
def test_before_any_was_measured_the_page_says_so(client: Client, measured: Any) -> None:
    measured("Pixel 8")

    page = plain(client, "/transfer/")

    assert f"No recommendation of front {NAME} has been measured since it was made." in page
    assert f"No map of devices has been made of front {NAME} yet." in page


@pytest.mark.slow
def test_recommendations_stand_beside_what_was_measured_and_the_published_best(
    client: Client, measured: Any
) -> None:
    one = measured("Pixel 8")
    one.submit(["default", "knee", "front-01", "front-01", "knee", "default"])
    recommend("knee", one.log_ratio("knee"), 0.1)
    recommend("front-01", one.log_ratio("front-01") + 0.3, 0.1)

    found = judgements(NAME)
    page = plain(client, "/transfer/")

    ratios = {name: one.log_ratio(name) for name in ("best", "knee", "front-01")}
    slower = {name: math.exp(max(ratios.values()) - ratio) for name, ratio in ratios.items()}
    assert [row.configuration for row in found.rows] == ["knee", "front-01"]
    assert [row.within_interval for row in found.rows] == [True, False]
    assert [row.regret for row in found.rows] == pytest.approx([slower["knee"], slower["front-01"]], rel=0.01)
    assert found.worst_regret == found.rows[0].regret
    assert found.median_best_regret == found.worst_best_regret == pytest.approx(slower["best"], rel=0.01)
    assert f"2 recommendations of front {NAME} were measured after they were made. 1 of them lay" in page
    assert "Google Pixel 8 knee" in page


@pytest.mark.slow
def test_the_models_stand_with_their_errors(client: Client, measured: Any) -> None:
    for number, chip in enumerate(("Mali-G715", "QUALCOMM Adreno(TM) 740", "Intel(R) UHD Graphics 620")):
        measured(f"Pixel {number + 6}", chip, probes=["probe-02", "probe-03"])
    maps.rebuild()

    page = plain(client, "/transfer/")
    row = DeviceMap.objects.get()

    assert set(row.errors) == {"power", "stages"}
    assert f"OpenCL GPU 3 {'power law' if row.rung == 'power' else 'stage model'}" in page
    assert " 6 3 " in page.partition("OpenCL GPU 3")[2]


@pytest.mark.slow
def test_one_front_serves_all_only_where_no_device_is_recommended_another_configuration(
    client: Client, measured: Any
) -> None:
    measured("Pixel 8", costs=BEST_IS_BEST)
    maps.rebuild()
    assert "One front serves all devices" in plain(client, "/transfer/")

    DeviceMap.objects.update(other_recommended=1)
    page = plain(client, "/transfer/")

    assert "One front serves all devices" not in page
    assert "For 1 of 1 device another configuration is recommended than the published best." in page


@pytest.mark.slow
def test_how_many_devices_are_recommended_another_is_counted_with_the_map(
    measured: Any, front: FrontVersion
) -> None:
    one = measured("Pixel 8")
    one.submit(["default", "knee", "knee", "default"])
    DeviceSpeedup.objects.filter(configuration__name="best").update(speedup=2.0)

    maps.rebuild()

    assert maps_of(front.slug).others == 1
    assert Maps([DeviceMap(other_recommended=None, devices=1)]).others is None
