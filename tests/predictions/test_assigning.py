"""What an installation is asked to measure besides default and best."""

import hashlib
from datetime import timedelta
from typing import Any

import pytest
from django.utils import timezone

from crowd.devices.models import Installation
from crowd.fronts.models import Configuration, FrontVersion
from crowd.predictions import maps, probe_assignment
from crowd.predictions.models import ProbeAssignment, ProbeRequest
from crowd.results.models import DeviceSpeedup, MeasurementSession, SessionSummary
from pareto.devices.probes import NEARLY_BEST
from tests.builders.known_front import NAME
from tests.builders.measured import Measured
from tests.builders.participant import Participant
from tests.predictions.test_recommending import DIFFERENT


def assign(device: Measured, minutes: float = 2.0) -> probe_assignment.Assignment:
    installation = Installation.objects.get(pk=device.participant.installation_id)
    assignment = probe_assignment.assign(installation, "kfusion", minutes)
    assert assignment is not None
    return assignment


def names(assignment: probe_assignment.Assignment) -> list[str]:
    return [one.point.name for one in assignment.probes]


@pytest.mark.slow
def test_three_that_teach_most_are_assigned_with_reasons_that_a_row_keeps_and_its_participant_reads(
    measured: Any,
) -> None:
    device = measured()

    assignment = assign(device)

    assert len(set(names(assignment))) == 3
    assert not {"default", "best"} & set(names(assignment))
    assert all(one.why == probe_assignment.TEACHES for one in assignment.probes)
    rows = list(ProbeAssignment.objects.order_by("pk"))
    assert [row.configuration.name for row in rows] == names(assignment)
    seed = hashlib.sha256(f"{device.participant.installation_id} 2".encode()).digest()[:6]
    for row in rows:  # the choice can be made again from it
        assert row.seed == int.from_bytes(seed, "big")
        assert row.gains[row.configuration.name] >= NEARLY_BEST * max(row.gains.values())
    shown = device.participant.own_data()["assignments"]
    assert [row["configuration"] for row in shown] == names(assignment)
    assert {(row["front_version"], row["why"]) for row in shown} == {(NAME, probe_assignment.TEACHES)}


@pytest.mark.slow
def test_asked_again_the_same_is_answered_until_it_is_measured(measured: Any) -> None:
    device = measured()
    first = names(assign(device))

    assert names(assign(device)) == first
    device.submit_probes(first[:2])
    assert names(assign(device)) == first[2:]
    device.submit_probes(first[2:])
    again = names(assign(device))

    assert len(again) == 3
    assert not set(again) & set(first)


@pytest.mark.slow
def test_an_assignment_of_yesterday_or_of_a_clock_that_was_set_back_holds_nothing(measured: Any) -> None:
    device = measured()
    assert len(names(assign(device))) == 3

    for count, hours in ((6, -25), (9, 1)):
        ProbeAssignment.objects.update(assigned_at=timezone.now() + timedelta(hours=hours))
        assert len(names(assign(device))) == 3
        assert ProbeAssignment.objects.count() == count, hours


def test_two_questions_at_once_have_one_answer(measured: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    device, choose, answers = measured(), probe_assignment._choose_probes, []

    def chosen_meanwhile(*arguments: Any) -> list[ProbeAssignment]:
        rows = choose(*arguments)
        monkeypatch.setattr(probe_assignment, "_choose_probes", choose)
        answers.append(names(assign(device)))
        return rows

    monkeypatch.setattr(probe_assignment, "_choose_probes", chosen_meanwhile)
    answers.append(names(assign(device)))

    assert answers[0] == answers[1]
    assert ProbeAssignment.objects.count() == 3


@pytest.mark.slow
def test_what_a_killed_client_left_half_done_is_asked_for_again(measured: Any) -> None:
    device = measured()
    first = names(assign(device))

    device.submit(["default", *first])  # one pair of each

    assert names(assign(device)) == first


def test_before_a_session_nothing_is_assigned(front: FrontVersion, join: Any) -> None:
    participant: Participant = join()
    assignment = probe_assignment.assign(
        Installation.objects.get(pk=participant.installation_id), "kfusion", 2.0
    )

    assert assignment is not None
    assert (assignment.probes, assignment.message) == ((), probe_assignment.NO_SESSION)
    assert probe_assignment.assign(Installation.objects.get(), "elasticfusion", 2.0) is None


@pytest.mark.slow
def test_a_device_that_slows_down_is_left_to_cool(measured: Any) -> None:
    assignment = assign(measured(slower_at_the_end=1.5))

    assert (assignment.probes, assignment.message) == ((), probe_assignment.TOO_HOT)


@pytest.mark.slow
def test_no_more_than_the_minutes_hold(measured: Any) -> None:
    """Which configurations are assigned depends on the installation's key, and so does how many fit."""
    device = measured(costs=dict.fromkeys(("preprocessing", "tracking", "integration", "raycasting"), 40.0))
    default = device.seconds("default") * 210 / 60  # minutes: two runs of 100 frames and the warm-up

    assigned = []
    for tenths in range(9, 26, 2):
        assigned.append(assign(device, tenths / 10 * default))
        ProbeAssignment.objects.all().delete()

    numbers = [len(names(each)) for each in assigned]
    assert numbers == sorted(numbers)
    assert (numbers[0], numbers[-1]) == (0, 3)
    assert {1, 2} & set(numbers)
    assert (assigned[0].probes, assigned[0].message) == ((), probe_assignment.TOO_SLOW)


@pytest.mark.slow
def test_what_administrators_ask_for_comes_first_on_such_chips_until_it_is_there(measured: Any) -> None:
    mali, adreno = measured("Pixel 8"), measured("Galaxy", "QUALCOMM Adreno(TM) 740")
    fast3 = Configuration.objects.get(name="fast3")
    ProbeRequest.objects.create(configuration=fast3, chip="mali", sessions=1, reason="fast3 on Mali")

    first = assign(mali)
    assert (names(first)[0], first.probes[0].why) == ("fast3", "The administrators request it: fast3 on Mali")
    assert len(names(first)) == 3
    assert "administrators" not in str(assign(adreno).probes)
    mali.submit_probes(["fast3"])
    assert "administrators" not in str(assign(measured("Pixel 7")).probes)


@pytest.mark.slow
def test_a_request_counts_a_network_once_and_only_assigned_sessions(measured: Any, settings: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    devices = [measured() for _ in range(4)]
    fast3 = Configuration.objects.get(name="fast3")
    ProbeRequest.objects.create(configuration=fast3, sessions=2, reason="fast3")
    unasked = measured(probes=["fast3"])
    unasked.submit_probes(["fast3"])

    for device in devices[:2]:
        Installation.objects.filter(pk=device.participant.installation_id).update(network="one")
        assert names(assign(device))[0] == "fast3"
        device.submit_probes(["fast3"])
    assert names(assign(devices[2]))[0] == "fast3"
    devices[2].submit_probes(["fast3"])

    assert "administrators" not in str(assign(devices[3]))


@pytest.mark.slow
def test_what_is_recommended_is_confirmed_first(measured: Any) -> None:
    device = measured(**DIFFERENT)
    maps.rebuild()

    assignment = assign(device)

    assert assignment.probes[0].why == probe_assignment.CONFIRMS
    assert assignment.probes[0].point.name not in ("default", "best")


@pytest.mark.slow
@pytest.mark.parametrize("sent", [0, 2])
def test_erasure_takes_the_assignments_too(measured: Any, sent: int) -> None:
    device = measured()
    chosen = names(assign(device))
    if sent:
        device.submit_probes(chosen[:sent])

    assert device.participant.delete("/me").status_code in (200, 204)

    assert not ProbeAssignment.objects.exists()


def test_before_the_session_is_worked_through_nothing_is_assigned(measured: Any) -> None:
    device = measured(slower_at_the_end=1.5)
    MeasurementSession.objects.update(summary_algorithm=None)

    assignment = assign(device)

    assert (assignment.probes, assignment.message) == ((), probe_assignment.NOT_READY)
    assert not ProbeAssignment.objects.exists()


@pytest.mark.slow
def test_without_a_valid_figure_the_default_of_the_session_tells_the_time(measured: Any) -> None:
    device = measured()
    SessionSummary.objects.update(state="suspect")
    DeviceSpeedup.objects.all().delete()
    default = device.seconds("default") * 210 / 60

    assert assign(device, 0.9 * default).message == probe_assignment.TOO_SLOW
    assert len(names(assign(device, 3 * default))) == 3


@pytest.mark.slow
def test_a_configuration_that_loses_the_camera_is_not_asked_for_again(measured: Any) -> None:
    device = measured()
    first = names(assign(device))
    device.submit_probes(first)
    SessionSummary.objects.filter(configuration__name=first[0]).update(state="invalid", log_ratio=None)

    assert first[0] not in names(assign(device))


@pytest.mark.slow
def test_another_backend_of_the_device_is_asked_for_its_own(measured: Any) -> None:
    device = measured()
    first = names(assign(device))
    device.submit_probes(first)
    MeasurementSession.objects.filter(runs__configuration__name__in=first).update(backend="webgpu")

    assert probe_assignment._done_configurations(MeasurementSession.objects.earliest("id")) == {
        "default",
        "best",
    }
    assert {"default", "best", *first} == probe_assignment._done_configurations(
        MeasurementSession.objects.latest("id")
    )
