"""Sessions that computed with WebAssembly: their threads, their processor, and a cohort of their own."""

from typing import Any

import pytest
from django.test import Client

from crowd.devices.catalogue import CatalogueLine, store
from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.devices.recognition import renormalise
from crowd.results import tasks
from crowd.results.figures import reassigning
from crowd.results.models import Cohort, MeasurementSession, SessionSummary
from crowd.results.opendata import exports
from tests.builders.crowds import Join
from tests.builders.documents import (
    browser_document,
    device_document,
    session_document,
    submission_document,
    wasm_session,
)
from tests.builders.measuring import measure
from tests.builders.participant import API, Participant
from tests.crowd.exported import table

WITHOUT_ADAPTER = dict.fromkeys(("gpu_vendor", "gpu_architecture", "gpu_device", "gpu_description"))
FIREFOX = browser_document("Linux", model=None, model_source=None, browser="Firefox", **WITHOUT_ADAPTER)
PHONE = browser_document(model="Pixel 8", **WITHOUT_ADAPTER)
NATIVE = {
    "os": "Debian GNU/Linux",
    "manufacturer": "Dell Inc.",
    "model": "XPS 15 9520",
    "cpu": "12th Gen Intel(R) Core(TM) i7-12700H",
    "opencl_platform": "wasmtime",
    "opencl_device": "12th Gen Intel(R) Core(TM) i7-12700H",
    "opencl_driver": "50.0.1",
}


def send(participant: Participant, device: dict[str, Any], **changes: Any) -> MeasurementSession:
    sent = wasm_session(**changes)
    response = participant.submit(submission_document(sent, device=device))
    assert response.status_code == 202, response.json()
    return MeasurementSession.objects.get(uuid=sent["id"])


def processor(session: MeasurementSession) -> tuple[str, str]:
    session.refresh_from_db()
    return session.processor, session.processor_class


def renormalised() -> None:
    """Rules or the catalogue changed, and the tasks have run."""
    renormalise(DeviceDescription.objects.all())
    reassigning.reassign_sessions(reassigning.changed_models())
    tasks.sweep()


def test_another_backend_may_say_that_it_has_none(participant: Participant) -> None:
    assert participant.submit(submission_document(session_document(threads=None))).status_code == 202
    assert MeasurementSession.objects.get().threads is None


def test_pages_api_open_data_and_own_data_show_the_threads(client: Client, participant: Participant) -> None:
    session = send(participant, device_document(), threads=4)
    exports.create_export()

    assert (session.threads, session.extra) == (4, {})
    assert "<dt>Threads</dt><dd>4</dd>" in client.get(f"/sessions/{session.uuid}/").content.decode()
    assert client.get(f"{API}/sessions/{session.uuid}").json()["threads"] == 4
    [row] = client.get(f"{API}/sessions").json()["results"]
    assert (row["backend"], row["threads"]) == ("wasm", 4)
    [own] = participant.own_data()["sessions"]
    assert own["threads"] == 4
    [exported] = table("sessions")
    assert (exported["backend"], exported["threads"]) == ("wasm", 4)


def test_the_backend_cpu_computes_on_the_processor_too(participant: Participant) -> None:
    without = device_document(opencl_platform=None, opencl_device=None)
    for device in (without, device_document("Pixel 8", os_version="15")):
        sent = session_document(backend="cpu")
        participant.submit(submission_document(sent, device=device))
        session = MeasurementSession.objects.get(uuid=sent["id"])
        assert processor(session) == ("Google Tensor G3", "cpu")
        renormalised()
        assert processor(session) == ("Google Tensor G3", "cpu")


def test_what_a_browser_claims_is_kept_for_its_participant(participant: Participant) -> None:
    session = send(participant, device_document(), threads=2, threads_claimed=8)

    assert (session.threads, session.extra) == (2, {"threads_claimed": 8})
    [own] = participant.own_data()["sessions"]
    assert own["extra"] == {"threads_claimed": 8}


@pytest.mark.parametrize("claimed", [-1, "8", 2.5])
def test_a_claim_is_a_number_of_processors(participant: Participant, claimed: Any) -> None:
    sent = wasm_session(threads=2, threads_claimed=claimed)

    response = participant.submit(submission_document(sent))

    assert (response.status_code, response.json()["field"]) == (400, "sessions[0].threads_claimed")


def test_no_other_session_shows_threads(client: Client, participant: Participant) -> None:
    sent = measure(participant)

    assert "Threads" not in client.get(f"/sessions/{sent['id']}/").content.decode()
    assert client.get(f"{API}/sessions/{sent['id']}").json()["threads"] is None


def test_its_figures_are_a_cohort_of_their_own(client: Client, participant: Participant) -> None:
    participant.submit(submission_document(session_document(best_us=10_000)))
    send(participant, device_document(), best_us=20_000)

    figures = {
        row["backend"]: (row["processor"], row["processor_class"], row["speedup"])
        for row in client.get(f"{API}/speedups").json()["results"]
        if row["configuration"] == "best"
    }

    assert figures == {
        "opencl": ("Mali-G715", "gpu", pytest.approx(8.0)),
        "wasm": ("Google Tensor G3", "cpu", pytest.approx(4.0)),
    }
    assert Cohort.objects.count() == 2
    assert "WebAssembly" in client.get("/devices/?backend=wasm").content.decode()
    (filtered,) = client.get(f"{API}/sessions?backend=wasm").json()["results"]
    assert filtered["backend"] == "wasm"


@pytest.mark.parametrize(
    ("device", "expected"),
    [
        (FIREFOX, "unknown processor"),
        (PHONE, "unknown processor"),
        (browser_document("Linux", model=None, gpu_vendor="nvidia"), "unknown processor"),
        (device_document(), "Google Tensor G3"),
        (device_document(opencl_platform=None, opencl_device=None), "Google Tensor G3"),
        (NATIVE, "Intel Core i7-12700H"),
        (NATIVE | {"cpu": None, "opencl_device": "x86_64"}, "unknown processor"),
    ],
)
def test_its_processor_is_that_of_the_device(
    participant: Participant, device: dict[str, Any], expected: str
) -> None:
    assert processor(send(participant, device)) == (expected, "cpu")


def test_its_driver_is_the_browser_or_wasmtime(participant: Participant, join: Join) -> None:
    assert send(participant, FIREFOX).driver == "Firefox 149"
    assert SessionSummary.objects.get().state == "valid"  # it counts as any other session
    assert send(join(), NATIVE).driver == "wasmtime 50.0.1"


@pytest.mark.parametrize("stated", [{}, {"manufacturer": "Google", "model_source": "owner"}])
def test_the_catalogue_names_the_chip_of_a_hinted_and_of_a_stated_model(
    participant: Participant, stated: dict[str, str]
) -> None:
    before = send(participant, PHONE | stated)
    store([CatalogueLine(1, "Google", "Pixel 8", "shiba", "Pixel 8", "Google Tensor G3", "")])
    renormalised()

    assert processor(before) == ("Google Tensor G3", "cpu")
    assert processor(send(participant, PHONE | stated)) == ("Google Tensor G3", "cpu")


def test_what_a_native_client_says_of_the_model_names_the_chip_of_earlier_sessions(
    participant: Participant, join: Join
) -> None:
    before = send(participant, PHONE)
    join().submit(submission_document(device=device_document()))
    reassigning.reassign_sessions(reassigning.changed_models())
    tasks.sweep()

    assert DeviceModel.objects.count() == 1
    assert processor(before) == ("Google Tensor G3", "cpu")
    assert {row.processor for row in Cohort.objects.filter(backend="wasm", summaries__isnull=False)} == {
        "Google Tensor G3"
    }


def test_new_rules_leave_the_chips_of_both_backends(participant: Participant) -> None:
    participant.submit(submission_document())
    computed = send(participant, device_document())
    DeviceModel.objects.update(changed=True)
    renormalised()

    assert processor(computed) == ("Google Tensor G3", "cpu")
    assert processor(MeasurementSession.objects.get(backend="opencl")) == ("Mali-G715", "gpu")


def test_the_same_browser_may_change_from_an_adapter_to_webassembly(participant: Participant) -> None:
    adapter = browser_document("Linux", model=None, browser="Firefox", gpu_vendor="intel")
    sent = submission_document(session_document(backend="webgpu"), device=adapter)
    assert participant.submit(sent).status_code == 202

    assert processor(send(participant, FIREFOX)) == ("unknown processor", "cpu")
