"""What the public sees of a model that few people have: its chip, everywhere."""

from typing import Any
from urllib.parse import quote

import pytest
from django.core.management import call_command
from django.test import Client

from crowd.devices import revision
from crowd.devices.disclosure import public_device
from crowd.devices.models import DeviceModel
from crowd.results.models import DeviceSpeedup, MeasurementSession
from crowd.results.privacy import disclosure_sync
from tests.builders.crowds import crowd
from tests.builders.participant import API
from tests.builders.rare import CHIP, NAMED, TELLING, Join, chip_of, masked, measure, work

pytestmark = pytest.mark.usefixtures("rare_below_five")


def public(client: Client, session: dict[str, Any]) -> dict[str, str]:
    """Every page and answer that may speak of `session`, by its address."""
    run, mask = session["runs"][0]["id"], masked()
    addresses = [
        "/",
        "/devices/",
        f"/devices/{mask}/",
        f"/sessions/{session['id']}/",
        f"/runs/{run}/",
        f"/compare/?devices={mask},other",
        "/fronts/kfusion-test/",
        "/figures/speedups.json",
        f"/figures/sessions/{session['id']}/frames.json",
        f"{API}/devices",
        f"{API}/devices/{mask}",
        f"{API}/speedups",
        f"{API}/speedups?since=2020-01-01",
        f"{API}/speedups?configuration=all",
        f"{API}/sessions",
        f"{API}/sessions/{session['id']}",
        f"{API}/runs",
        f"/devices/{NAMED}/",
        f"{API}/devices/{NAMED}",
    ]
    return {address: client.get(address).content.decode() for address in addresses}


@pytest.mark.slow
def test_a_rare_model_is_named_nowhere(client: Client, front: Any, join: Join) -> None:
    session = measure(join())

    for address, content in public(client, session).items():
        if NAMED in address:
            continue  # a page that is missing repeats what was asked for
        assert not [text for text in TELLING if text in content], address
    assert client.get(f"/devices/{NAMED}/").status_code == 404
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    assert CHIP in client.get(f"/devices/{masked()}/").content.decode()
    assert client.get(f"{API}/devices/{masked()}").json()["name"].startswith(f"{CHIP} (")


@pytest.mark.parametrize("period", ["", "&since=2020-01-01"])
def test_nobody_finds_a_rare_model_by_its_own_name(
    client: Client, front: Any, join: Join, period: str
) -> None:
    measure(join())

    for name in ("Pixel 8", "Google Pixel 8", "pixel", "husky", NAMED):
        answer = client.get(f"{API}/speedups?device={quote(name)}{period}").json()
        assert (answer["results"], answer["summary"]["devices"]) == ([], 0), name
    (row,) = client.get(f"{API}/speedups?device=Tensor{period}").json()["results"]
    assert row["device"] == masked()


def test_rare_models_of_one_chip_keep_figures_of_their_own(client: Client, front: Any, join: Join) -> None:
    """Labels are masked after the computation: pooling models by their label would change the figure."""
    measure(join(), best_us=20_000)
    crowd(join, {"Pixel 8 Pro": 16.0})

    rows = client.get(f"{API}/speedups").json()["results"]

    assert [(chip_of(row["name"]), round(row["speedup"], 6), row["masked"]) for row in rows] == [
        (CHIP, 16.0, True),
        (CHIP, 4.0, True),
    ]
    assert len({row["device"] for row in rows}) == len({row["name"] for row in rows}) == 2


def test_the_fifth_installation_names_the_model(client: Client, front: Any, join: Join) -> None:
    for _ in range(4):
        measure(join())
    mask = masked()
    assert [row["device"] for row in client.get(f"{API}/speedups").json()["results"]] == [mask]

    session = measure(join())

    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["installations"]) == (NAMED, 5)
    assert client.get(f"/devices/{mask}/").status_code == 404
    assert "Pixel 8" in client.get(f"/sessions/{session['id']}/").content.decode()


def test_one_eager_installation_names_nothing(client: Client, front: Any, join: Join) -> None:
    who = join()
    for _ in range(6):
        measure(who)

    assert [row["device"] for row in client.get(f"{API}/speedups").json()["results"]] == [masked()]


def test_an_erasure_makes_a_model_rare_again(client: Client, front: Any, join: Join) -> None:
    members = [join() for _ in range(5)]
    for who in members:
        measure(who)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200

    assert members[0].delete("/me").status_code == 204

    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["installations"]) == (masked(), 4)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404


def test_nothing_remains_of_a_model_that_nobody_measures(client: Client, front: Any, join: Join) -> None:
    who = join()
    measure(who)

    who.delete("/me")

    assert not DeviceModel.objects.exists()
    assert client.get(f"{API}/devices").json()["results"] == []


def test_a_threshold_of_one_names_every_model(client: Client, front: Any, join: Join, settings: Any) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 1

    measure(join())

    assert [row["device"] for row in client.get(f"{API}/speedups").json()["results"]] == [NAMED]


def test_a_new_threshold_counts_once_the_rules_are_run_again(
    client: Client, front: Any, join: Join, settings: Any
) -> None:
    measure(join())
    settings.FRONTRUNNER_RARE_BELOW = 1

    call_command("devices", "renormalise")
    work()

    assert [row["device"] for row in client.get(f"{API}/speedups").json()["results"]] == [NAMED]


def test_counting_twice_changes_nothing(front: Any, join: Join) -> None:
    for _ in range(5):
        measure(join())
    before = list(DeviceSpeedup.objects.values_list("device__slug", "speedup", "sessions"))

    disclosure_sync.after_arrival(list(MeasurementSession.objects.values_list("pk", flat=True)))
    work()

    assert list(DeviceSpeedup.objects.values_list("device__slug", "speedup", "sessions")) == before


@pytest.mark.parametrize(
    ("parts", "name"),
    [
        ({"os": "Android", "soc": "Google Tensor G3", "gpu": "Mali-G715"}, "Google Tensor G3 device"),
        ({"os": "Android", "gpu": "Adreno 506"}, "Adreno 506 device"),
        ({"os": "Android", "cpu": "ARMv7"}, "Android device, unknown chip"),
        ({"os": "Linux", "cpu": "AMD EPYC", "gpu": "NVIDIA H100"}, "AMD EPYC PC"),
        ({"os": "Windows", "gpu": "AMD Radeon RX 480"}, "AMD Radeon RX 480 PC"),
        ({"os": "macOS", "cpu": "Apple M1"}, "Apple M1 Mac"),
        ({"os": "Linux"}, "Linux PC, unknown chip"),
        ({}, "Device, unknown chip"),
        ({"os": "Android", "soc": "ranchu", "kind": "emulator"}, "Android emulator"),
    ],
)
def test_a_mask_says_the_chip(parts: dict[str, str], name: str) -> None:
    device = public_device(DeviceModel(mask="a1b2c3", **parts))

    assert (device.name, device.manufacturer, device.masked) == (f"{name} (ahbj)", "", True)


def test_a_name_that_no_rule_knows_stays_masked_however_many_measured_it(
    client: Client, front: Any, join: Join
) -> None:
    for _ in range(6):
        measure(join())
    DeviceModel.objects.update(named=False)
    revision.bump()

    (row,) = client.get(f"{API}/speedups").json()["results"]

    assert (chip_of(row["name"]), row["masked"]) == (CHIP, True)
