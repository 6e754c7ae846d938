"""The simulated crowd: plausible, repeatable by seed, labelled, never mixed in, gone at one command."""

import json
from typing import Any

import numpy as np
import pytest
from django.core.management import CommandError, call_command
from django.test import Client

from crowd.audit.models import AuditEntry
from crowd.devices import permits
from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.devices.naming.normalisation import identify
from crowd.devices.naming.processors import processor_of
from crowd.devices.naming.raw_device import RawDevice
from crowd.devices.naming.vendors import VENDORS
from crowd.devices.recognition import recognise
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from crowd.predictions.models import ProbeAssignment
from crowd.predictions.tables import chip_series
from crowd.results.models import Cohort, DeviceSpeedup, MeasurementSession, Run, SessionSummary, Tombstone
from crowd.results.simulation import devices as made_up
from crowd.results.simulation import sessions as made_up_sessions
from crowd.results.simulation.stages import STAGES, frame_stages, stage_shares
from crowd.results.validity import version
from tests.crowd.documents import (
    BAND,
    STANDARD,
    device_document,
    front_document,
    submission_document,
    trajectory,
)
from tests.crowd.participant import API, Participant

PACK = {"name": "test-sequence", "sha256": "0" * 64}


@pytest.fixture
def configurations() -> tuple[made_up.Configuration, ...]:
    return made_up.read_configurations(front_document(PACK))


def test_the_same_seed_makes_the_same_crowd(configurations: tuple[made_up.Configuration, ...]) -> None:
    one, same, other = (made_up.devices(30, configurations, seed) for seed in (1, 1, 2))

    assert [device.descriptions for device in one] == [device.descriptions for device in same]
    assert all(np.array_equal(a.seconds, b.seconds) for a, b in zip(one, same, strict=True))
    assert any(
        a.seconds.shape != b.seconds.shape or a.name != b.name for a, b in zip(one, other, strict=True)
    )


def test_the_crowd_of_another_front_has_the_same_devices(
    configurations: tuple[made_up.Configuration, ...],
) -> None:
    other = [made_up.Configuration(str(n), {"icp_weight": n + 1}, 0.1, 0.01, BAND, {}) for n in range(5)]

    here, there = (made_up.devices(30, front, 1) for front in (configurations, other))

    assert [device.descriptions for device in here] == [device.descriptions for device in there]


def test_devices_of_one_family_scale_alike(configurations: tuple[made_up.Configuration, ...]) -> None:
    """What a configuration gains differs more between families than within one."""
    wide = [made_up.Configuration(str(n), STANDARD, 0.02, 0.01, BAND, stages_of(n)) for n in range(8)]
    gains: dict[str, list[Any]] = {}
    for device in made_up.devices(200, wide, 3):
        logs = np.log(device.seconds.mean(axis=(0, 1)))
        gains.setdefault(device.family.name, []).append(logs - logs.mean())

    within = np.mean([np.var(rows, axis=0).mean() for rows in gains.values() if len(rows) > 2])
    between = np.var([np.mean(rows, axis=0) for rows in gains.values()], axis=0).mean()
    assert between > within > 0


def stages_of(number: int) -> dict[str, float]:
    """Each stage longer than the others by turns."""
    return {
        name: 0.01 if place == number % len(STAGES) else 0.002 * (1 + number // len(STAGES))
        for place, name in enumerate(STAGES)
    }


def test_times_follow_from_what_each_stage_costs_on_a_device() -> None:
    """Where one stage takes nearly all the time, two configurations with it gain alike on every device."""
    alone = dict.fromkeys(STAGES, 1e-5) | {"tracking": 0.02}
    mixed = dict.fromkeys(STAGES, 0.005)
    front = [
        made_up.Configuration(str(n), STANDARD, 0.02, 0.01, BAND, stages)
        for n, stages in enumerate([alone, alone, mixed])
    ]

    logs = np.log([device.seconds.mean(axis=(0, 1)) for device in made_up.devices(200, front, 3)])

    assert (logs[:, 0] - logs[:, 1]).std() < 0.1 < (logs[:, 0] - logs[:, 2]).std()


def test_shares_of_stages_differ_between_devices_and_leave_a_rest(
    configurations: tuple[made_up.Configuration, ...],
) -> None:
    shares = np.array([device.shares[0] for device in made_up.devices(30, configurations, 0)])

    assert (shares.std(axis=0) > 0.01).all()
    assert (shares.sum(axis=1) < 1).all()


def test_a_crowd_of_83_has_chips_of_many_series(configurations: tuple[made_up.Configuration, ...]) -> None:
    crowd = made_up.devices(83, configurations, 0)
    chips = [processor_of(RawDevice.parse(device.descriptions[0])) for device in crowd]

    assert len({chip_series(chip.name) for chip in chips if chip.kind == "gpu"}) >= 20


def test_every_description_is_recognised_as_its_familys_chip(
    configurations: tuple[made_up.Configuration, ...],
) -> None:
    for device in made_up.devices(60, configurations, 0):
        identity = identify(device.descriptions[0], simulated=True)
        assert device.family.name in VENDORS
        assert identity.kind == "simulated"
        assert identity.slug.startswith("simulated-")
        assert not identity.slug.startswith("simulated-simulated-")


def test_a_stage_that_comes_every_nth_frame_makes_it_dear() -> None:
    stages = frame_stages(STANDARD | {"integration_rate": 4}, np.array([0.004, 0.004, 0.004, 0.008]), 100)
    frames = stages.sum(axis=0)

    assert frames.mean() == pytest.approx(0.02)
    assert set(np.flatnonzero(frames > 1.2 * np.median(frames))) == set(range(0, 100, 4))


def test_without_stages_a_stage_that_comes_rarely_has_a_smaller_share() -> None:
    often, rarely = (stage_shares(STANDARD | {"integration_rate": rate}, {}) for rate in (1, 16))

    assert often == pytest.approx(list(STAGES.values()))
    assert rarely.sum() == pytest.approx(1)
    assert rarely[2] / rarely[0] == pytest.approx(often[2] / often[0] / 4)


def test_a_session_of_every_configuration_comes_back_the_way_it_went(
    configurations: tuple[made_up.Configuration, ...],
) -> None:
    probe = made_up.Configuration("probe", STANDARD, 0.02, 0.01, BAND, {}, probe=True)
    front = (*configurations, probe)

    names = made_up_sessions.run_order(front_document(PACK)["protocol"], front, every=True)

    assert names == ["default", "best", "accurate", "accurate", "best", "default"]


def enrol(client: Client, **changes: Any) -> Any:
    wish = {"app": "x", "app_version": "0.1.0", "consent_version": 2} | changes
    return client.post(f"{API}/enrol", json.dumps(wish), content_type="application/json")


def test_nobody_enrols_as_simulated_without_a_permit(client: Client, front: FrontVersion) -> None:
    refused = enrol(client, simulated="yes")
    enrolled = enrol(client, simulated=permits.permit())

    assert (refused.status_code, refused.json()["code"]) == (403, "simulation_not_permitted")
    assert enrolled.status_code == 201
    assert [row.simulated for row in Installation.objects.all()] == [True]


def test_what_is_simulated_joins_no_real_device_and_is_shown_where_it_is_asked_for(
    client: Client, participant: Participant
) -> None:
    """The same strings as those of a real device, and yet another model."""
    made_up_participant = Participant(client, enrol(client, simulated=permits.permit()).json()["token"], "")
    for sender in (participant, made_up_participant, made_up_participant):
        assert sender.submit(submission_document()).status_code == 202

    real, simulated = (
        client.get(f"{API}/devices{query}").json()["results"] for query in ("", "?simulated=1")
    )

    assert [(row["slug"], row["sessions"], row["simulated"]) for row in real] == [
        ("google-pixel-8", 1, False)
    ]
    assert [(row["slug"], row["sessions"]) for row in simulated] == [("simulated-google-pixel-8", 2)]
    assert client.get(f"{API}/speedups").json()["summary"]["sessions"] == 1
    assert client.get(f"{API}/speedups?simulated=1").json()["summary"]["sessions"] == 2
    assert client.get(f"{API}/devices/simulated-google-pixel-8").json()["simulated"] is True
    pair = client.get(f"{API}/compare?devices=google-pixel-8,simulated-google-pixel-8")
    assert (pair.status_code, pair.json()["field"]) == (400, "devices")


def test_a_simulated_model_is_named_however_few_measured_it_and_stays_simulated(
    db: None, settings: Any
) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 3
    recognise(device_document(), simulated=True)
    recognise(device_document())

    kinds = {model.kind: model for model in DeviceModel.objects.exclude(kind="group")}

    assert {kind: model.rare for kind, model in kinds.items()} == {"device": True, "simulated": False}


def test_an_erased_simulation_leaves_no_tombstone(client: Client, front: FrontVersion) -> None:
    sender = Participant(client, enrol(client, simulated=permits.permit()).json()["token"], "")
    sender.submit(submission_document())

    assert sender.delete("/me").status_code == 204
    assert not Tombstone.objects.exists()


@pytest.mark.django_db(transaction=True)  # its requests close their connections
def test_a_crowd_measures_by_the_protocol_of_the_front(
    client: Client, db: None, pack: dict[str, Any]
) -> None:
    publish_content(front_document(pack, pairs=4))

    call_command("simulate_crowd", "--devices", "3", "--sessions", "2", "--seed", "4", "--probes", "0")

    assert set(MeasurementSession.objects.values_list("protocol_version", "stage_clock")) == {(2, "wall")}
    assert set(SessionSummary.objects.values_list("pairs", "reason")) == {(4, "")}


@pytest.mark.django_db(transaction=True)  # its requests close their connections
def test_a_crowd_is_simulated_and_removed(
    client: Client, participant: Participant, capsys: pytest.CaptureFixture[str]
) -> None:
    participant.submit(submission_document())
    before = client.get(f"{API}/speedups").json()

    call_command("simulate_crowd", "--devices", "3", "--sessions", "2", "--seed", "4")

    assert "3 of 3 devices, 6 sessions" in capsys.readouterr().out
    assert client.get(f"{API}/speedups").json() == before
    assert client.get(f"{API}/speedups?simulated=1").json()["summary"]["devices"] == 3
    assert set(MeasurementSession.objects.values_list("summary_algorithm", flat=True)) == {version.ALGORITHM}

    with pytest.raises(CommandError, match="--remove"):
        call_command("simulate_crowd", "--devices", "3", "--sessions", "2", "--seed", "4")

    call_command("simulate_crowd", "--remove")

    assert client.get(f"{API}/speedups?simulated=1").json()["summary"]["devices"] == 0
    assert client.get(f"{API}/speedups").json() == before
    assert not Installation.objects.filter(simulated=True).exists()
    assert not DeviceDescription.objects.filter(simulated=True).exists()
    assert not DeviceModel.objects.filter(slug__startswith="simulated").exists()
    assert [MeasurementSession.objects.count(), Run.objects.count()] == [1, 4]
    assert (Cohort.objects.count(), DeviceSpeedup.objects.count()) == (1, 1)
    assert not Tombstone.objects.exists()


@pytest.mark.django_db(transaction=True)  # its requests close their connections
def test_installations_measure_the_probes_that_they_are_asked_for(
    client: Client, db: None, pack: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    document = front_document(pack)
    for point in document["configurations"]:
        point["predicted"] |= {"runtime": point["predicted"]["runtime"] / 20}  # two minutes are enough
    probe = document["configurations"][2] | {
        "name": "probe-01",
        "parameters": STANDARD | {"mu": 0.2},
        "trajectory": trajectory(0.02),
    }
    publish_content(document | {"probes": [probe]})

    call_command("simulate_crowd", "--devices", "2", "--sessions", "1", "--seed", "4", "--probes", "1")

    assert "2 of 2 devices, 2 sessions of probes" in capsys.readouterr().out
    asked = set(ProbeAssignment.objects.values_list("installation", "configuration__name"))
    probes = Run.objects.exclude(configuration__name__in=["default", "best"])
    measured = probes.filter(repeat=0).values_list("session__installation", "configuration__name")
    assert {name for _, name in asked} >= {"probe-01"}
    assert asked <= set(measured)
    summaries = SessionSummary.objects.filter(configuration__name="probe-01")
    assert set(summaries.values_list("pairs", "state")) == {(2, "valid")}
    assert set(DeviceSpeedup.objects.values_list("device__kind", flat=True)) == {"simulated"}


@pytest.mark.django_db(transaction=True)  # its requests close their connections
def test_nothing_is_sent_where_nothing_is_asked_for(client: Client, db: None, pack: dict[str, Any]) -> None:
    document = front_document(pack)
    publish_content(document | {"configurations": document["configurations"][:2]})

    call_command("simulate_crowd", "--devices", "2", "--sessions", "1", "--seed", "4", "--probes", "1")

    assert MeasurementSession.objects.count() == 2


@pytest.mark.parametrize("share", ["-0.1", "1.5", "nan"])
def test_the_share_of_probes_is_a_share(db: None, share: str) -> None:
    with pytest.raises(CommandError, match="from 0 to 1"):
        call_command("simulate_crowd", f"--probes={share}")


def test_a_permit_that_is_printed_is_logged(db: None, capsys: pytest.CaptureFixture[str]) -> None:
    call_command("simulate_crowd", "--permit")

    assert permits.is_valid(capsys.readouterr().out.strip())
    entry = AuditEntry.objects.get()
    assert (entry.actor, entry.action, entry.subject) == ("command line", "permit issued", "simulated crowd")
