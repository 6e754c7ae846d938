"""What the public sees of a model that few people have: its chip, everywhere; its owner sees the name."""

import importlib
import json
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

import pytest
from django.apps import apps
from django.core.management import call_command
from django.test import Client
from django.utils import timezone

from crowd.devices import disclosure, recognition
from crowd.devices.disclosure import group_of
from crowd.devices.models import DeviceModel, Installation
from crowd.results import tasks
from crowd.results.figures import summarising
from crowd.results.models import DeviceSpeedup, MeasurementSession
from crowd.results.privacy import publication
from crowd.results.privacy.own_page import path_of
from tests.crowd.documents import device_document, run_document, session_document, submission_document
from tests.crowd.participant import API, Participant

Join = Callable[[], Participant]

GROUP = "google-tensor-g3-device"
NAMED = "google-pixel-8"
CALLED_A_GROUP = {"manufacturer": "group", "model": "Google Tensor G3 device", "os": "Android 14", "cpu": "x"}
# What of a phone's own strings may be nowhere in public while the phone is rare.
TELLING = ("Pixel 8", "pixel-8", "husky-build-77", "3a7f")


@pytest.fixture(autouse=True)
def five(settings: Any) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5


def measure(who: Participant, best_us: int = 10_000, **changes: Any) -> dict[str, Any]:
    """One session of WHO on a phone whose strings tell more than its model; the stored session's document."""
    device = device_document() | {
        "board": "husky-build-77",
        "opencl_driver": "3.0 v1.r44p1-00eac0.3a7f",
    }
    session = session_document(best_us=best_us)
    answer = who.submit(submission_document(session, device=device, **changes))
    assert answer.status_code == 202, answer.content
    return session


def work() -> None:
    """What a worker does of what waits."""
    publication.republish_waiting()
    summarising.summarise_waiting()


def public(client: Client, session: dict[str, Any]) -> dict[str, str]:
    """Every page and answer that may speak of SESSION, by its address."""
    run = session["runs"][0]["id"]
    addresses = [
        "/",
        "/devices/",
        f"/devices/{GROUP}/",
        f"/sessions/{session['id']}/",
        f"/runs/{run}/",
        f"/compare/?devices={GROUP},other",
        "/fronts/kfusion-test/",
        "/figures/speedups.json",
        f"/figures/sessions/{session['id']}/frames.json",
        f"{API}/devices",
        f"{API}/devices/{GROUP}",
        f"{API}/speedups",
        f"{API}/speedups?since=2020-01-01",
        f"{API}/speedups?configuration=all",
        f"/devices/{NAMED}/",
        f"{API}/devices/{NAMED}",
    ]
    return {address: client.get(address).content.decode() for address in addresses}


def test_a_rare_model_is_named_nowhere(client: Client, front: Any, join: Join) -> None:
    session = measure(join())

    for address, content in public(client, session).items():
        if NAMED in address:
            continue  # a page that is missing repeats what was asked for
        assert not [text for text in TELLING if text in content], address
    assert client.get(f"/devices/{NAMED}/").status_code == 404
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    assert "Google Tensor G3 device" in client.get(f"/devices/{GROUP}/").content.decode()
    assert client.get(f"{API}/devices/{GROUP}").json()["name"] == "Google Tensor G3 device"


@pytest.mark.parametrize("period", ["", "&since=2020-01-01"])
def test_nobody_finds_a_rare_model_by_its_own_name(
    client: Client, front: Any, join: Join, period: str
) -> None:
    measure(join())

    for name in ("Pixel 8", "Google Pixel 8", "pixel", "husky", NAMED):
        answer = client.get(f"{API}/speedups?device={quote(name)}{period}").json()
        assert (answer["results"], answer["summary"]["devices"]) == ([], 0), name
    (row,) = client.get(f"{API}/speedups?device=Tensor{period}").json()["results"]
    assert row["device"] == GROUP


def test_a_group_pools_the_rare_models_of_one_chip(client: Client, front: Any, join: Join) -> None:
    measure(join(), best_us=20_000)
    join().submit(submission_document(session_document(best_us=5_000), device=device_document("Pixel 8 Pro")))

    (row,) = client.get(f"{API}/speedups").json()["results"]

    # 4 and 16 times faster, on two models.
    assert (row["device"], round(row["speedup"], 6), row["installations"]) == (GROUP, 8.0, 2)


def test_the_fifth_installation_names_the_model(client: Client, front: Any, join: Join) -> None:
    for _ in range(4):
        measure(join())
    assert [row["device"] for row in client.get(f"{API}/speedups").json()["results"]] == [GROUP]

    session = measure(join())

    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["installations"]) == (NAMED, 5)
    assert client.get(f"/devices/{GROUP}/").status_code == 404
    assert "Pixel 8" in client.get(f"/sessions/{session['id']}/").content.decode()


def test_no_device_can_call_itself_a_group(client: Client, front: Any, join: Join) -> None:
    measure(join())

    answer = join().submit(submission_document(session_document(), device=CALLED_A_GROUP))

    assert answer.status_code == 202
    group = DeviceModel.objects.get(slug=GROUP)
    assert (group.kind, group.cpu, group.descriptions.count()) == (DeviceModel.Kind.GROUP, "", 0)
    assert not MeasurementSession.objects.filter(description__model__slug=GROUP).exists()


def test_a_device_that_had_taken_a_groups_place_gets_its_own(
    front: Any, join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as before:
        before.setattr(disclosure, "PREFIX", "group|")
        measure(join())
        join().submit(submission_document(session_document(), device=CALLED_A_GROUP))
    group = DeviceModel.objects.get(slug=GROUP)
    assert group.descriptions.count() == 1

    migration = importlib.import_module("crowd.devices.migrations.0004_keys_of_groups")
    migration.apart(apps, None)
    recognition.renormalise_waiting()
    work()

    group.refresh_from_db()
    assert (group.kind, group.group, group.rare) == (DeviceModel.Kind.GROUP, None, False)
    assert group.key.startswith(disclosure.PREFIX)
    assert group.descriptions.count() == 0
    assert group.rare_models.get().slug == NAMED
    assert DeviceModel.objects.get(manufacturer="Group").descriptions.count() == 1


def test_one_eager_installation_names_nothing(client: Client, front: Any, join: Join) -> None:
    who = join()
    for _ in range(6):
        measure(who)

    assert [row["device"] for row in client.get(f"{API}/speedups").json()["results"]] == [GROUP]


def test_an_erasure_makes_a_model_rare_again(client: Client, front: Any, join: Join) -> None:
    crowd = [join() for _ in range(5)]
    for who in crowd:
        measure(who)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200

    assert crowd[0].delete("/me").status_code == 204

    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["installations"]) == (GROUP, 4)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404


def test_nothing_remains_of_a_model_that_nobody_measures(client: Client, front: Any, join: Join) -> None:
    who = join()
    measure(who)

    who.delete("/me")

    assert not DeviceModel.objects.exists()
    assert client.get(f"{API}/devices").json()["results"] == []


def test_who_agrees_is_named_alone(client: Client, front: Any, join: Join) -> None:
    measure(join(), best_us=20_000)
    measure(join(), best_us=5_000, show_model=True)

    rows = client.get(f"{API}/speedups").json()["results"]

    assert [(row["device"], round(row["speedup"], 6)) for row in rows] == [(NAMED, 16.0), (GROUP, 4.0)]


def test_raw_strings_of_others_do_not_show_with_who_agrees(client: Client, front: Any, join: Join) -> None:
    measure(join())
    join().submit(submission_document(show_model=True))

    page = client.get(f"/devices/{NAMED}/").content.decode()

    assert "Pixel 8" in page
    assert "husky-build-77" not in page


def test_the_choice_may_be_taken_back(
    client: Client, front: Any, join: Join, django_capture_on_commit_callbacks: Any
) -> None:
    who = join()
    measure(who, show_model=True)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200

    with django_capture_on_commit_callbacks(execute=True):
        measure(who, show_model=False)

    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["sessions"]) == (GROUP, 2)


def test_the_choice_holds_for_sessions_that_compare_nothing_too(
    client: Client, front: Any, join: Join, django_capture_on_commit_callbacks: Any
) -> None:
    """No configuration beside the baseline: no summary, no figure, but a device in the list."""
    who = join()
    alone = session_document(runs=[run_document("default", 0, 0, 80_000)])
    who.submit(submission_document(alone, show_model=True))
    assert [row["slug"] for row in client.get(f"{API}/devices").json()["results"]] == [NAMED]

    with django_capture_on_commit_callbacks(execute=True):
        measure(who, show_model=False)

    rows = client.get(f"{API}/devices").json()["results"]
    assert [(row["slug"], row["sessions"]) for row in rows] == [(GROUP, 2)]


@pytest.mark.parametrize(("module", "limit", "value"), [(publication, "BATCH", 2), (summarising, "LARGE", 3)])
def test_a_name_is_hidden_at_once_however_much_was_measured(
    client: Client,
    front: Any,
    join: Join,
    monkeypatch: pytest.MonkeyPatch,
    module: Any,
    limit: str,
    value: int,
) -> None:
    """What takes long waits for the sweep; what may no longer be seen does not."""
    crowd = [join() for _ in range(5)]
    for who in crowd:
        measure(who)
    monkeypatch.setattr(module, limit, value)

    crowd[0].delete("/me")

    for address in ("devices", "speedups", "speedups?since=2020-01-01"):
        assert NAMED not in client.get(f"{API}/{address}").content.decode(), address
    tasks.sweep()
    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["installations"]) == (GROUP, 4)


def test_a_submission_that_says_nothing_changes_no_choice(front: Any, join: Join) -> None:
    who = join()
    measure(who, show_model=True)

    measure(who)
    work()

    assert {row.device.slug for row in MeasurementSession.objects.select_related("device")} == {NAMED}


def test_the_own_link_shows_the_own_model(client: Client, front: Any, join: Join) -> None:
    who = join()
    answer = who.submit(submission_document())
    state = who.get(f"/submissions/{answer.json()['submission_id']}").json()

    page = client.get(state["page"])

    assert state["device"] == GROUP
    assert page.status_code == 200
    assert page["X-Robots-Tag"] == "noindex"
    content = page.content.decode()
    assert "Google Pixel 8" in content
    assert "Everybody else sees it as" in content
    assert "Google Tensor G3 device" in content


def test_an_own_link_is_nobody_elses(client: Client, front: Any, join: Join, installation: Any) -> None:
    other = join()
    measure(other)
    path = path_of(installation)

    assert "Pixel 8" not in client.get(path).content.decode()
    forged = path.replace(installation.pk.hex, other.installation_id.replace("-", ""))
    assert client.get(forged).status_code == 404


def test_an_own_link_ends_with_the_installation(
    client: Client, participant: Participant, installation: Any
) -> None:
    measure(participant)
    path = path_of(installation)
    assert "Pixel 8" in client.get(path).content.decode()

    participant.delete("/me")

    assert client.get(path).status_code == 404


def test_an_own_link_works_after_the_token_was_revoked(
    client: Client, participant: Participant, installation: Any
) -> None:
    measure(participant)
    path = path_of(installation)

    Installation.objects.update(revoked_at=timezone.now())

    assert "Pixel 8" in client.get(path).content.decode()


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


def test_own_data_name_the_own_device(front: Any, join: Join) -> None:
    who = join()
    measure(who)

    answer = who.get("/me/data")
    content = b"".join(answer.streaming_content) if answer.streaming else answer.content

    assert "husky-build-77" in json.dumps(json.loads(content))


def test_settling_twice_changes_nothing(front: Any, join: Join) -> None:
    for _ in range(5):
        measure(join())
    before = list(DeviceSpeedup.objects.values_list("device__slug", "speedup", "sessions"))

    publication.settle(list(MeasurementSession.objects.values_list("pk", flat=True)))
    work()

    assert list(DeviceSpeedup.objects.values_list("device__slug", "speedup", "sessions")) == before


@pytest.mark.parametrize(
    ("parts", "name"),
    [
        ({"os": "Android", "soc": "Google Tensor G3", "gpu": "Mali-G715"}, "Google Tensor G3 device"),
        ({"os": "Android", "gpu": "Adreno 506"}, "Adreno 506 device"),
        ({"os": "Android", "cpu": "ARMv7"}, "Other Android device"),
        ({"os": "Linux", "cpu": "AMD EPYC", "gpu": "NVIDIA H100"}, "AMD EPYC PC"),
        ({"os": "Windows", "gpu": "AMD Radeon RX 480"}, "AMD Radeon RX 480 PC"),
        ({"os": "macOS", "cpu": "Apple M1"}, "Apple M1 Mac"),
        ({"os": "Linux"}, "Other Linux PC"),
        ({}, "Other device"),
        ({"os": "Android", "soc": "ranchu", "kind": "emulator"}, "Android emulator"),
    ],
)
def test_a_group_is_named_after_its_chip(parts: dict[str, str], name: str) -> None:
    assert group_of(DeviceModel(**parts)).name == name
