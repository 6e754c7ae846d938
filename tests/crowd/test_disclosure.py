"""What the public sees of a model that few people have: its chip, everywhere; its owner sees the name."""

import json
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

import pytest
from django.core.management import call_command
from django.test import Client
from django.utils import timezone

from crowd.devices import revision
from crowd.devices.disclosure import public_device
from crowd.devices.models import DeviceModel, Installation
from crowd.results import tasks
from crowd.results.figures import reassigning
from crowd.results.figures import sessions as session_figures
from crowd.results.models import DeviceSpeedup, ExportFile, MeasurementSession, SessionSummary
from crowd.results.opendata import exports
from crowd.results.privacy import disclosure
from crowd.results.privacy.own_page import path_of
from crowd.results.validity.version import ALGORITHM
from tests.crowd.documents import device_document, run_document, session_document, submission_document
from tests.crowd.participant import API, Participant

Join = Callable[[], Participant]

NAMED = "google-pixel-8"
CHIP = "Google Tensor G3 device"
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
    """A worker does what waits."""
    disclosure.sync_disclosure(reassigning.reassign_sessions(reassigning.changed_models()))
    session_figures.summarise_waiting()


def masked() -> str:
    """The public address of the phone, which has a mask."""
    device = public_device(DeviceModel.objects.get(slug=NAMED))
    assert device.masked
    return device.slug


def public(client: Client, session: dict[str, Any]) -> dict[str, str]:
    """Every page and answer that may speak of SESSION, by its address."""
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


def test_a_rare_model_is_named_nowhere(client: Client, front: Any, join: Join) -> None:
    session = measure(join())

    for address, content in public(client, session).items():
        if NAMED in address:
            continue  # a page that is missing repeats what was asked for
        assert not [text for text in TELLING if text in content], address
    assert client.get(f"/devices/{NAMED}/").status_code == 404
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    assert CHIP in client.get(f"/devices/{masked()}/").content.decode()
    assert client.get(f"{API}/devices/{masked()}").json()["name"] == CHIP


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
    join().submit(submission_document(session_document(best_us=5_000), device=device_document("Pixel 8 Pro")))

    rows = client.get(f"{API}/speedups").json()["results"]

    assert [(row["name"], round(row["speedup"], 6), row["masked"]) for row in rows] == [
        (CHIP, 16.0, True),
        (CHIP, 4.0, True),
    ]
    assert len({row["device"] for row in rows}) == 2


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
    crowd = [join() for _ in range(5)]
    for who in crowd:
        measure(who)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200

    assert crowd[0].delete("/me").status_code == 204

    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["installations"]) == (masked(), 4)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404


def test_nothing_remains_of_a_model_that_nobody_measures(client: Client, front: Any, join: Join) -> None:
    who = join()
    measure(who)

    who.delete("/me")

    assert not DeviceModel.objects.exists()
    assert client.get(f"{API}/devices").json()["results"] == []


def test_a_rare_model_is_named_once_all_agree(client: Client, front: Any, join: Join) -> None:
    measure(join(), best_us=20_000, show_model=True)
    measure(join(), best_us=5_000, show_model=True)

    (row,) = client.get(f"{API}/speedups").json()["results"]

    assert (row["device"], row["installations"]) == (NAMED, 2)


def test_one_who_does_not_agree_masks_the_model_at_once(
    client: Client, front: Any, join: Join, no_worker: None
) -> None:
    """Before any task has run."""
    measure(join(), show_model=True)
    tasks.sweep()
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200

    measure(join())

    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    assert client.get(f"{API}/devices/{masked()}").status_code == 200


def test_raw_strings_are_never_shown(client: Client, front: Any, join: Join) -> None:
    measure(join(), show_model=True)

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
    assert (row["device"], row["sessions"]) == (masked(), 2)


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
    assert [(row["slug"], row["sessions"]) for row in rows] == [(masked(), 2)]


def test_a_choice_moves_no_session(client: Client, front: Any, join: Join) -> None:
    """It costs the server little, however often somebody changes their mind."""
    who = join()
    measure(who)
    before = list(SessionSummary.objects.values_list("pk", "cohort"))

    for choice in (False, True):
        who.submit(submission_document(session_document(), show_model=choice))

    assert list(SessionSummary.objects.values_list("pk", "cohort"))[: len(before)] == before
    assert not MeasurementSession.objects.filter(summary_algorithm__lt=ALGORITHM).exists()
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200


def choose(who: Participant, content: Any) -> Any:
    return who.client.patch(f"{API}/me", content, content_type="application/json", headers=who.headers)


def test_the_choice_changes_without_a_measurement(client: Client, front: Any, join: Join) -> None:
    who = join()
    measure(who)
    hidden = masked()

    shown = choose(who, {"show_model": True})
    assert (shown.status_code, shown.json()["show_model"]) == (200, True)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200
    assert choose(who, {"show_model": False}).json()["show_model"] is False
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    assert client.get(f"{API}/devices/{hidden}").status_code == 200


def test_a_name_is_shown_again_after_an_hour_and_hidden_at_any_time(front: Any, join: Join) -> None:
    who = join()
    measure(who)
    for show in (True, False):
        assert choose(who, {"show_model": show}).status_code == 200

    again = choose(who, {"show_model": True})

    assert (again.status_code, again.json()["code"]) == (429, "too_many_requests")
    assert 3_000 < int(again.headers["Retry-After"]) <= 3_600
    assert who.get("/me").json()["show_model"] is False
    assert choose(who, {"show_model": False}).status_code == 200


def test_open_data_follow_a_choice_without_a_measurement(
    front: Any, join: Join, django_capture_on_commit_callbacks: Any
) -> None:
    who = join()
    measure(who, show_model=True)
    exports.make()
    assert not ExportFile.objects.filter(stale=True).exists()

    with django_capture_on_commit_callbacks():
        choose(who, {"show_model": False})

    assert {file.table for file in ExportFile.objects.filter(stale=True)} >= {"devices", "sessions"}


@pytest.mark.parametrize("content", [{}, {"show_model": None}, {"show_model": "yes"}, [True]])
def test_a_choice_is_yes_or_no(front: Any, join: Join, content: Any) -> None:
    answer = choose(join(), content)

    assert (answer.status_code, answer.json()["code"]) == (400, "invalid_field")


def test_an_installation_reads_what_it_is(client: Client, front: Any, join: Join) -> None:
    who = join()
    answer = who.get("/me")

    assert answer.json() == {
        "installation_id": who.installation_id,
        "app": "client_kit",
        "app_version": "0.1.0",
        "consent_version": 1,
        "show_model": False,
        "page": path_of(Installation.objects.get()),
    }
    assert answer.headers["Cache-Control"] == "no-store"
    assert client.get(f"{API}/me").status_code == 401


def test_a_submission_that_says_nothing_changes_no_choice(front: Any, join: Join) -> None:
    who = join()
    measure(who, show_model=True)

    measure(who)
    work()

    assert Installation.objects.get().show_model


def test_the_own_link_shows_the_own_model(client: Client, front: Any, join: Join) -> None:
    who = join()
    answer = who.submit(submission_document())
    state = who.get(f"/submissions/{answer.json()['submission_id']}").json()

    page = client.get(state["page"])

    assert state["device"] == masked()
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


def test_counting_twice_changes_nothing(front: Any, join: Join) -> None:
    for _ in range(5):
        measure(join())
    before = list(DeviceSpeedup.objects.values_list("device__slug", "speedup", "sessions"))

    disclosure.after_arrival(list(MeasurementSession.objects.values_list("pk", flat=True)))
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
    device = public_device(DeviceModel(**parts))

    assert (device.name, device.manufacturer, device.masked) == (name, "", True)


def test_a_name_that_no_rule_knows_stays_masked_however_many_measured_it(
    client: Client, front: Any, join: Join
) -> None:
    for _ in range(6):
        measure(join())
    DeviceModel.objects.update(named=False)
    revision.bump()

    (row,) = client.get(f"{API}/speedups").json()["results"]

    assert (row["name"], row["masked"]) == (CHIP, True)
