"""The devices, sessions and searches of a demo server: plausible, repeatable by seed, sent once."""

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from django.conf import LazySettings
from django.test import Client
from django.utils import timezone

from crowd.demo.mark import admitting
from crowd.devices.models import DeviceModel, Installation
from crowd.devices.naming.chips import VENDORS
from crowd.devices.naming.computing import processor_of
from crowd.devices.naming.identity import identify
from crowd.devices.naming.raw_device import RawDevice
from crowd.explorations.models import Evaluation, Exploration
from crowd.fronts import sequences
from crowd.fronts.content import front_file
from crowd.fronts.publishing.services import publish_content
from crowd.predictions.models import ProbeAssignment
from crowd.predictions.tables import chip_series
from crowd.results.figures import recomputing
from crowd.results.models import Export, MeasurementSession, Run, SessionSummary
from crowd.simulation import devices as made_up
from crowd.simulation import exploration, filling
from crowd.simulation import sessions as made_up_sessions
from crowd.simulation.crowd import Crowd
from crowd.simulation.stages import STAGES, frame_stages, stage_shares
from crowd.simulation.transport import Transport
from tests.builders.documents import BAND, STANDARD, front_document, trajectory
from tests.builders.participant import API
from tests.shipped import KFUSION, LIVING_ROOM
from wire.front import Errors

TODAY = datetime(2026, 11, 20, tzinfo=UTC)
Configurations = tuple[made_up.Configuration, ...]
ERRORS = Errors(0.01, 0.004, 0.005)
PACK = {"name": "test-sequence", "sha256": "0" * 64}


@pytest.fixture
def configurations() -> Configurations:
    return made_up.read_configurations(front_document(PACK))


def test_the_same_seed_makes_the_same_crowd(configurations: Configurations) -> None:
    one, same, other = (made_up.devices(30, configurations, seed) for seed in (1, 1, 2))

    assert [device.descriptions for device in one] == [device.descriptions for device in same]
    assert all(np.array_equal(a.seconds, b.seconds) for a, b in zip(one, same, strict=True))
    assert any(
        a.seconds.shape != b.seconds.shape or a.name != b.name for a, b in zip(one, other, strict=True)
    )


def test_the_crowd_of_another_front_has_the_same_devices(
    configurations: Configurations,
) -> None:
    other = [made_up.Configuration(str(n), {"icp_weight": n + 1}, 0.1, ERRORS, BAND, {}) for n in range(5)]

    here, there = (made_up.devices(30, front, 1) for front in (configurations, other))

    assert [device.descriptions for device in here] == [device.descriptions for device in there]


def test_devices_of_one_family_scale_alike(configurations: Configurations) -> None:
    """What a configuration gains differs more between families than within one."""
    wide = [made_up.Configuration(str(n), STANDARD, 0.02, ERRORS, BAND, stages_of(n)) for n in range(8)]
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
        made_up.Configuration(str(n), STANDARD, 0.02, ERRORS, BAND, stages)
        for n, stages in enumerate([alone, alone, mixed])
    ]

    logs = np.log([device.seconds.mean(axis=(0, 1)) for device in made_up.devices(200, front, 3)])

    assert (logs[:, 0] - logs[:, 1]).std() < 0.1 < (logs[:, 0] - logs[:, 2]).std()


def test_shares_of_stages_differ_between_devices_and_leave_a_rest(
    configurations: Configurations,
) -> None:
    shares = np.array([device.shares[0] for device in made_up.devices(30, configurations, 0)])

    assert (shares.std(axis=0) > 0.01).all()
    assert (shares.sum(axis=1) < 1).all()


def test_a_crowd_of_83_has_chips_of_many_series(configurations: Configurations) -> None:
    crowd = made_up.devices(83, configurations, 0)
    chips = [processor_of(RawDevice.parse(device.descriptions[0])) for device in crowd]

    assert len({chip_series(chip.name) for chip in chips if chip.kind == "gpu"}) >= 20


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
    configurations: Configurations,
) -> None:
    probe = made_up.Configuration("probe", STANDARD, 0.02, ERRORS, BAND, {}, probe=True)
    front = (*configurations, probe)

    names = made_up_sessions.run_order(front_document(PACK)["protocol"], front, every=True)

    assert names == ["default", "best", "accurate", "accurate", "best", "default"]


def test_the_errors_of_a_run_are_at_most_twice_its_deviation_from_those_of_the_reference(
    configurations: Configurations,
) -> None:
    document = front_document(PACK)
    for point in document["configurations"]:
        point["reference_ate"] = {"ate_max": 0.0016, "ate_mean": 0.0003, "ate_rmse": 0.0004}
    front, manifest = made_up.read_configurations(document), document | {"front_version": "kfusion-test"}

    runs = [
        run
        for device in made_up.devices(20, front, 0)
        for run in made_up_sessions.session(
            device, 0, 0, front, manifest, True, TODAY, np.random.default_rng(0)
        )["runs"]
        if run["status"] == "ok"
    ]

    for run in runs:
        assert 0 <= run["ate_mean"] <= run["ate_rmse"] <= run["ate_max"]
        for name, error in document["configurations"][0]["reference_ate"].items():
            assert abs(run[name] - error) <= 2 * run["deviation"]
    assert len({run["ate_max"] for run in runs}) > 20


def test_every_description_is_recognised_as_its_familys_chip(
    configurations: Configurations, demo: None
) -> None:
    for device in made_up.devices(60, configurations, 0):
        identities = [identify(raw) for raw in (*device.descriptions, *device.browser_descriptions)]
        assert device.family.name in VENDORS
        assert all(one.named for one in identities), device.name
        assert len({one.key for one in identities}) == 1


def test_some_devices_measure_in_the_driver_some_in_the_browser_and_some_in_both(
    configurations: Configurations,
) -> None:
    backends = [
        frozenset(map(device.backend, range(device.installations)))
        for device in made_up.devices(83, configurations, 0)
    ]

    assert set(backends) == {
        frozenset({"opencl"}),
        frozenset({"webgpu"}),
        frozenset({"opencl", "webgpu"}),
    }


def crowd(count: int, sessions: int) -> Crowd:
    return Crowd(Transport(), count, 4, TODAY, sessions)


@pytest.mark.slow
def test_a_crowd_measures_by_the_protocol_of_the_front(demo: None, pack: dict[str, Any]) -> None:
    publish_content(front_document(pack, pairs=4))

    with admitting():
        list(crowd(3, 2).send())
    recomputing.recompute(lambda _done: None)

    assert set(MeasurementSession.objects.values_list("protocol_version", flat=True)) == {2}
    assert set(SessionSummary.objects.values_list("pairs", "reason")) == {(4, "")}


@pytest.mark.slow
def test_all_runs_of_the_front_that_ships_are_taken(demo: None, settings: LazySettings) -> None:
    """Its true poses are known, so errors and deviations bind each other."""
    settings.FRONTRUNNER_SEQUENCES = [LIVING_ROOM.parent]
    sequences.open_pack.cache_clear()
    front, _ = publish_content(front_file.read(KFUSION))
    assert all(point.reference_ate for point in front.content.every)

    with admitting():
        sender = crowd(4, 1)
        sent = [each.document for place in range(4) for each in sender._sessions(place)]
        *_, last = sender.send()

    assert last.runs == sum(len(session["runs"]) for session in sent)


@pytest.mark.slow
def test_what_was_interrupted_goes_on_and_nothing_is_sent_twice(demo: None, pack: dict[str, Any]) -> None:
    publish_content(front_document(pack))
    with admitting():
        next(crowd(3, 2).send())
        some = MeasurementSession.objects.count()
        list(crowd(3, 2).send())
        last = list(crowd(3, 2).send())[-1]

    assert (some, MeasurementSession.objects.count(), last.sessions) == (2, 6, 0)


@pytest.mark.slow
def test_installations_measure_the_probes_that_they_are_asked_for(demo: None, pack: dict[str, Any]) -> None:
    document = front_document(pack)
    for point in document["configurations"]:
        point["predicted"] |= {"runtime": point["predicted"]["runtime"] / 20}  # two minutes are enough
    probe = document["configurations"][2] | {
        "name": "probe-01",
        "parameters": STANDARD | {"mu": 0.2},
        "trajectory": trajectory(0.02),
    }
    publish_content(document | {"probes": [probe]})

    with admitting():
        sender = crowd(2, 1)
        list(sender.send())
        recomputing.recompute(lambda _done: None)
        list(sender.send_probes(1.0))

    asked = set(ProbeAssignment.objects.values_list("installation", "configuration__name"))
    probes = Run.objects.exclude(configuration__name__in=["default", "best"])
    measured = probes.filter(repeat=0).values_list("session__installation", "configuration__name")
    assert {name for _, name in asked} >= {"probe-01"}
    assert asked <= set(measured)


def test_a_demo_server_is_filled_once(client: Client, demo: None, pack: dict[str, Any]) -> None:
    publish_content(front_document(pack))
    lines: list[str] = []

    filling.fill(2, 0, lines.append)
    filling.fill(2, 0, lines.append)
    filling.fill(2, 1, lines.append)

    assert "2 simulated devices" in lines[-2]
    assert "another seed" in lines[-1]
    assert MeasurementSession.objects.filter(summary_algorithm=None).count() == 0
    assert DeviceModel.objects.count() == 2
    assert "" not in Installation.objects.values_list("network", flat=True)
    assert [row["simulated"] for row in client.get(f"{API}/devices").json()["results"]] == [True, True]
    search = Exploration.objects.get()
    assert search.state == Exploration.State.DONE
    assert not search.evaluations.filter(state=Evaluation.State.PENDING).exists()


@pytest.mark.slow
def test_a_demo_that_was_interrupted_after_its_devices_is_completed(demo: None, pack: dict[str, Any]) -> None:
    publish_content(front_document(pack))
    with admitting():
        list(Crowd(Transport(), 1, 0, timezone.now()).send())

    filling.fill(1, 0, lambda _: None)

    assert MeasurementSession.objects.filter(summary_algorithm=None).count() == 0
    assert (Exploration.objects.get().state, Export.objects.count()) == ("done", 1)


def test_errors_of_a_made_up_search_grow_as_its_times_shrink() -> None:
    slow, fast = (exploration.measurement(STANDARD | {"compute_size_ratio": n}) for n in (1, 8))

    assert fast["objectives"]["runtime"] < slow["objectives"]["runtime"]
    assert fast["objectives"]["ate_max"] > slow["objectives"]["ate_max"]


def test_a_configuration_that_leaves_out_frames_has_its_share_and_its_mean(
    configurations: Configurations,
) -> None:
    front = [replace(one, skipped=0.6 if one.name == "best" else None) for one in configurations]
    device = replace(made_up.devices(1, front, 1)[0], failing="")
    protocol = {"version": 2, "frames": 104, "repeats": 2, "order": ["default", "best", "best", "default"]}
    manifest = {"protocol": protocol, "application": "kfusion", "front_version": "kfusion-test"}

    random = np.random.default_rng(1)
    made = made_up_sessions.session(device, 0, 0, front, manifest, False, TODAY, random)

    skipped = {run["configuration"]: run["tracked"][4:].count(None) for run in made["runs"]}
    assert skipped["best"] == 60
    for run in made["runs"]:
        left_out = [
            us for us, tracked in zip(run["frame_us"], run["tracked"], strict=True) if tracked is None
        ]
        assert run["configuration"] == "default" or max(left_out[4:]) < 10
