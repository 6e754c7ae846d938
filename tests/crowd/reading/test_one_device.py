"""One installation is one physical device: what describes another is refused as a whole."""

import json
import uuid
from typing import Any

import pytest
from django.db import connection
from django.test import Client

from crowd.access.addresses import network_hash
from crowd.devices.models import DeviceDescription, Installation
from crowd.devices.services import bind_device
from crowd.http.problems import Problem
from crowd.results.models import MeasurementSession, Submission
from tests.builders.crowds import Join
from tests.builders.documents import device_document, submission_document
from tests.builders.participant import API, Participant
from tests.crowd.refusals import problem

ENROLMENT = {"app": "test", "app_version": "0.1.0", "consent_version": 2}
PC: dict[str, Any] = {
    "os": "Debian GNU/Linux",
    "manufacturer": "LENOVO",
    "model": "21CB",
    "soc_manufacturer": None,
    "soc_model": None,
    "cpu": "AMD Ryzen 7 PRO 6850U with Radeon Graphics",
}


def described(installation: Participant) -> DeviceDescription | None:
    return Installation.objects.get(pk=installation.installation_id).description


def test_the_first_submission_binds_the_installation_to_its_device(participant: Participant) -> None:
    assert described(participant) is None

    participant.submit(submission_document())

    assert described(participant) == DeviceDescription.objects.get()


def test_another_device_is_refused_as_a_whole(participant: Participant) -> None:
    participant.submit(submission_document())

    response = participant.submit(submission_document(device=device_document("Pixel 9")))

    assert problem(response) == (409, "device_changed", "device")
    assert "Pixel 9: enrol again for a second device" in response.json()["detail"]
    assert (Submission.objects.count(), MeasurementSession.objects.count()) == (1, 1)
    assert DeviceDescription.objects.count() == 1


def test_a_dry_run_says_the_same_and_binds_nothing(participant: Participant) -> None:
    other = submission_document(device=device_document("Pixel 9"))
    assert participant.submit(other, path="/submissions:validate").status_code == 200
    assert described(participant) is None

    participant.submit(submission_document())

    assert problem(participant.submit(other, path="/submissions:validate"))[:2] == (409, "device_changed")


def test_a_second_installation_measures_the_second_device(participant: Participant, join: Join) -> None:
    participant.submit(submission_document())

    assert join().submit(submission_document(device=device_document("Pixel 9"))).status_code == 202


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({}, {"os_version": "17", "opencl_driver": "3.0 v1.r51p0"}),
        (
            PC | {"opencl_platform": "AMD", "opencl_device": "gfx1035", "opencl_driver": "3590.0"},
            PC | {"opencl_platform": "Portable Computing Language", "opencl_device": "cpu-znver3"},
        ),
    ],
)
def test_a_new_system_driver_or_opencl_device_is_the_same_device(
    participant: Participant, before: dict[str, Any], after: dict[str, Any]
) -> None:
    first = participant.submit(submission_document(device=device_document(**before)))
    bound = described(participant)

    second = participant.submit(submission_document(device=device_document(**after)))

    assert (first.status_code, second.status_code) == (202, 202)
    assert DeviceDescription.objects.count() == 2
    assert described(participant) == bound


def test_of_two_devices_that_come_first_at_once_one_is_refused(participant: Participant, join: Join) -> None:
    """The request's own copy of the installation is older than what another request has stored."""
    stale = Installation.objects.get(pk=participant.installation_id)
    participant.submit(submission_document())
    other = device_document("Pixel 9")
    join().submit(submission_document(device=other))
    description = DeviceDescription.objects.get(raw__model="Pixel 9")
    MeasurementSession.objects.filter(installation=stale).delete()

    with pytest.raises(Problem) as refused:
        bind_device(stale, description.pk, other, "")

    assert refused.value.code == "device_changed"


@pytest.mark.parametrize(
    ("address", "other", "same"),
    [
        ("203.0.113.7", "203.0.113.250", True),
        ("203.0.113.7", "203.0.114.7", False),
        ("203.0.113.7", "::ffff:203.0.113.9", True),
        ("2001:db8:1:2::3", "2001:db8:1:ffff::9", True),
        ("2001:db8:1::3", "2001:db8:2::3", False),
        ("0.0.0.1", "::1", False),
    ],
)
def test_a_network_is_a_24_or_a_48(rf: Any, address: str, other: str, same: bool) -> None:
    first, second = (network_hash(rf.get("/", REMOTE_ADDR=each)) for each in (address, other))

    assert (first == second) is same
    assert len(first) == 32
    assert int(first, 16)


def test_a_network_is_a_hash_under_this_servers_key(rf: Any, settings: Any) -> None:
    request = rf.get("/", REMOTE_ADDR="203.0.113.7")
    here = network_hash(request)

    settings.SECRET_KEY = "another server's"

    assert network_hash(request) != here
    assert network_hash(rf.get("/", REMOTE_ADDR="unknown")) == ""


def test_an_enrolment_keeps_the_network_and_its_participant_sees_it(
    client: Client, db: None, rf: Any
) -> None:
    response = client.post(
        f"{API}/enrol", ENROLMENT, content_type="application/json", REMOTE_ADDR="203.0.113.7"
    )

    network = network_hash(rf.get("/", REMOTE_ADDR="203.0.113.99"))
    enrolled = Participant(client, response.json()["token"], response.json()["installation_id"])
    assert Installation.objects.get().network == network
    assert enrolled.own_data()["installation"]["network"] == network
    with connection.cursor() as cursor:
        cursor.execute("SELECT * FROM devices_installation")
        assert "203.0.113" not in str(cursor.fetchall())


def test_a_network_that_is_not_known_is_noted_with_the_next_submission(
    participant: Participant, rf: Any
) -> None:
    Installation.objects.update(network="")
    installation = Installation.objects.get()

    for address in ("203.0.113.7", "198.51.100.7"):
        participant.client.post(
            f"{API}/submissions",
            json.dumps(submission_document()),
            content_type="application/json",
            headers=participant.headers | {"Idempotency-Key": str(uuid.uuid4())},
            REMOTE_ADDR=address,
        )

    installation.refresh_from_db()
    assert installation.network == network_hash(rf.get("/", REMOTE_ADDR="203.0.113.7"))
