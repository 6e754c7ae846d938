"""What the map of devices says on pages: its models, whether one front serves all, a device's own front."""

from typing import Any

import pytest
from django.test import Client

from crowd.predictions import maps
from crowd.predictions.models import DeviceMap
from tests.builders.measured import BEST_IS_BEST
from tests.dashboard.reading import plain, read
from tests.predictions.conftest import document, front, measured, published

__all__ = ["document", "front", "measured", "published"]

pytestmark = pytest.mark.django_db


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
def test_a_device_has_its_own_front_measured_and_predicted(client: Client, measured: Any) -> None:
    measured("Pixel 8", costs=BEST_IS_BEST)
    measured("Pixel 7", costs=BEST_IS_BEST, probes=["probe-02"])
    (row,) = maps.rebuild()

    page = plain(client, "/devices/google-pixel-8/")

    assert "Best for you within 5.00 cm best :" in page
    assert "(measured here)" in page
    assert "Google Pixel 7 : its chip is of the series Mali-G7" in page
    assert "which learned from 2 devices in 2 sessions with OpenCL on graphics chips" in page
    assert "Measured configurations are the figures of the table below." in page
    assert f"from the map of {row.made_at:%Y-%m-%d}" in page
    rows = client.get("/tables/devices/google-pixel-8/front.json").json()["rows"]
    states = {row["configuration"]: row["state"] for row in rows}
    assert (states["best"], states["knee"], states["probe-02"]) == ("measured", "predicted", "predicted")


@pytest.mark.slow
def test_rare_devices_keep_their_masks(client: Client, measured: Any, settings: Any) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    measured("Pixel 8")
    measured("Pixel 7")
    maps.rebuild()
    public = client.get("/api/v1/devices").json()["results"]

    addresses = [f"/devices/{row['slug']}/" for row in public]
    pages = [read(client, address) for address in (*addresses, "/recommend/?gpu=Mali-G715", "/transfer/")]

    assert len(addresses) == 2
    assert "Its own front" in pages[0]
    assert not any("Pixel" in page for page in pages)
    assert "no measured device" in read(client, "/recommend/?model=Pixel+8")
