"""Preparing a draft: what is measured, what clients then get, and when it stops."""

from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest
from django.core.exceptions import ValidationError
from django.test import Client
from django.utils import timezone

from crowd.explorations import lease_api, services, steering
from crowd.explorations.measuring import leases, reaping, tokens
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import publishing
from crowd.explorations.preparing import preparation
from crowd.fronts import manifests, selectors
from crowd.fronts.content import front_file, plans
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services as fronts
from tests.builders.explorations import finish, run_to_the_end

Phase = Evaluation.Phase


@pytest.fixture
def draft(exploration: Exploration) -> FrontVersion:
    """A draft of an exploration's front, not prepared."""
    return fronts.create_draft(publishing.front_document(run_to_the_end(exploration), "7"), by="ann")


@pytest.fixture
def begun(draft: FrontVersion) -> Exploration:
    """Its preparation, whose references are measured and whose times are not."""
    preparing = preparation.create(draft)
    finish(services.pending_evaluations(preparing))
    return preparing


def names(rows: Any) -> list[str]:
    return [row.label for row in rows]


def test_a_draft_cannot_be_submitted_before_it_is_prepared(draft: FrontVersion) -> None:
    with pytest.raises(
        front_file.InvalidFrontError, match=r"band of default: is missing: .*front prepare kfusion-7"
    ):
        fronts.submit(draft)

    assert run_to_the_end(preparation.create(draft)).state == "done"
    fronts.publish(fronts.submit(draft, by="ann"))


def test_each_point_runs_on_every_device_and_then_all_in_rounds_beside_the_default(
    draft: FrontVersion,
) -> None:
    points = list(draft.configurations.values_list("name", flat=True))

    begun = run_to_the_end(preparation.create(draft))

    references = begun.evaluations.filter(phase=Phase.REFERENCE)
    assert names(references) == points
    first_round = begun.evaluations.filter(phase=Phase.TIME, iteration=0)
    assert names(first_round)[0] == "default"
    assert set(names(first_round)) == set(points)
    front = selectors.front_in_any_state(draft.pk)
    assert {times.rounds for point in front.points if (times := point.predicted.on_sequence)} == {4}
    assert all(point.program and point.trajectory_sha256 and point.band for point in front.points)
    best = front.point("best")
    assert best is not None
    on_sequence = best.predicted.on_sequence
    assert on_sequence is not None
    assert on_sequence.low <= on_sequence.runtime_ratio <= on_sequence.high < 1
    assert front.provenance["prepared"]["variants"] == ["Bench CPU 1.0, rows", "Bench CPU 1.0, pixels"]


def test_what_was_measured_before_a_kill_is_not_measured_again(draft: FrontVersion) -> None:
    begun = preparation.create(draft)
    done, lost, *_ = services.pending_evaluations(begun)
    finish([done])
    assert leases.take(lost.pk, "a worker that is killed") is not None
    Evaluation.objects.filter(pk=lost.pk).update(lease_until=timezone.now() - timedelta(seconds=1))

    reaping.reap()
    again = preparation.create(draft)

    assert again == begun
    assert done not in services.pending_evaluations(begun)
    assert lost in services.pending_evaluations(begun)
    assert run_to_the_end(begun).state == "done"
    assert begun.evaluations.get(pk=done.pk).attempt == 1


def test_a_cancelled_preparation_leaves_the_draft_as_it_was_and_another_one_can_begin(
    draft: FrontVersion,
) -> None:
    begun = preparation.create(draft)
    finish(services.pending_evaluations(begun)[:1])
    services.cancel(begun)
    digest = draft.digest

    draft.refresh_from_db()
    assert draft.digest == digest
    another = preparation.create(draft)
    assert another != begun
    assert run_to_the_end(another).state == "done"


def test_a_point_whose_devices_differ_too_much_is_left_out_by_name(
    begun: Exploration, draft: FrontVersion
) -> None:
    widen(begun, "accurate")

    run_to_the_end(begun)

    front = selectors.front_in_any_state(draft.pk)
    reason = front.provenance["prepared"]["left_out"]["accurate"]
    assert reason.startswith("devices differ by 9.0 mm, so its band would be 2.7 cm, more than 2 cm")
    assert "accurate" not in names(begun.evaluations.filter(phase=Phase.TIME))


@pytest.mark.parametrize("name", ["default", "best"])
def test_default_and_best_stop_a_draft_whose_devices_differ_too_much(begun: Exploration, name: str) -> None:
    widen(begun, name)

    run_to_the_end(begun)

    assert begun.state == "paused"
    assert begun.note.startswith(f"{name}: devices differ by 9.0 mm")
    assert not begun.evaluations.filter(phase=Phase.TIME).exists()


def disturb(begun: Exploration, waited: float) -> list[Evaluation]:
    """Measure what is pending, and return what is next. Threads of best wait `waited` times as long as they
    compute."""
    finish(services.pending_evaluations(begun))
    for row in begun.evaluations.filter(phase=Phase.TIME, label="best"):
        if "waited_seconds" not in row.objectives:
            row.objectives |= {"cpu_seconds": 0.01, "waited_seconds": 0.01 * waited}
            row.save(update_fields=["objectives"])
    return services.advance(begun.pk)


def test_a_disturbed_round_is_measured_again_and_then_waits_for_a_person(
    begun: Exploration, draft: FrontVersion
) -> None:
    services.advance(begun.pk)
    for attempt in (2, 3, 4):
        assert names(disturb(begun, waited=2.0)) == ["default", "best"]
        assert begun.evaluations.filter(phase=Phase.TIME, label="best", iteration=0).count() == attempt

    assert disturb(begun, waited=2.0) == []
    begun.refresh_from_db()
    disturbed = "other programs disturbed best in round 1, 4 times: end them, then resume"
    assert (begun.state, begun.note) == ("paused", disturbed)

    services.resume(begun)
    assert names(services.advance(begun.pk)) == ["default", "best"]
    disturb(begun, waited=0.1)
    assert run_to_the_end(begun).state == "done"
    prepared = selectors.front_in_any_state(draft.pk).provenance["prepared"]
    assert prepared["disturbed_runs"] == 4


def test_it_stops_where_the_default_cannot_be_timed(begun: Exploration) -> None:
    default, *_ = services.advance(begun.pk)
    Evaluation.objects.filter(pk=default.pk).update(state=Evaluation.State.FAILED, error="no driver")

    run_to_the_end(begun)

    assert (begun.state, begun.note) == ("paused", "default cannot be timed: no driver")
    assert not begun.evaluations.filter(phase=Phase.TIME, iteration=1).exists()


@pytest.mark.parametrize(
    "variants",
    [["Bench CPU 1.0, rows"], [f"Bench CPU 50, WebAssembly, threads: {threads}" for threads in (1, 2)]],
)
def test_a_single_variant_says_nothing_of_other_devices(begun: Exploration, variants: list[str]) -> None:
    change_references(begun, lambda found: found | {"variants": variants})

    run_to_the_end(begun)

    assert begun.state == "paused"
    assert "install an OpenCL driver" in begun.note


def test_a_draft_that_changed_meanwhile_keeps_its_new_content(draft: FrontVersion) -> None:
    begun = preparation.create(draft)
    changed = front_file.document(selectors.content(selectors.front_in_any_state(draft.pk)))
    changed["provenance"] |= {"note": "corrected"}
    fronts.create_draft(changed, by="ann")

    run_to_the_end(begun)

    assert (begun.state, "prepare it again" in begun.note) == ("paused", True)
    draft.refresh_from_db()
    assert draft.content.provenance["note"] == "corrected"


def test_only_a_draft_is_prepared_and_a_released_front_as_its_next_version(draft: FrontVersion) -> None:
    run_to_the_end(preparation.create(draft))
    fronts.submit(draft)
    with pytest.raises(ValidationError, match="kfusion-7 is in review"):
        preparation.create(draft)
    fronts.publish(draft)

    begun = steering.prepare(draft, "ann")

    assert str(begun.prepares) == "kfusion-8"
    assert selectors.current("kfusion").slug == "kfusion-7"  # type: ignore[union-attr]


def test_its_author_stays_who_drafted_it(draft: FrontVersion, settings: Any) -> None:
    settings.FRONTRUNNER_SECOND_PERSON = True
    run_to_the_end(preparation.create(draft))
    fronts.submit(draft, by="ben")

    for author in ("ann", "ben"):
        with pytest.raises(fronts.second_person.SecondPersonError):
            fronts.publish(draft, by=author)
    fronts.publish(draft, by="eve")


def test_references_of_an_earlier_program_are_measured_again(
    begun: Exploration, draft: FrontVersion, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = draft.configurations.count()
    monkeypatch.setattr(plans, "program_digest", lambda *_: "f" * 64)

    again = services.advance(begun.pk)

    assert [(row.phase, row.iteration) for row in again] == [(Phase.REFERENCE, 0)] * points
    run_to_the_end(begun)
    assert {point.program for point in selectors.front_in_any_state(draft.pk).points} == {"f" * 64}


@pytest.mark.slow
def test_a_front_of_an_earlier_program_is_not_offered_until_it_is_prepared_again(
    draft: FrontVersion, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_to_the_end(preparation.create(draft))
    fronts.publish(fronts.submit(draft))
    assert client.get("/api/v1/manifest").status_code == 200
    monkeypatch.setattr(plans, "program_digest", lambda *_: "f" * 64)

    manifests._build.cache_clear()  # another program is another process
    refused = client.get("/api/v1/manifest")

    assert (refused.status_code, refused.json()["code"]) == (404, "front_outdated")
    assert "prepared it again" in refused.json()["detail"]
    assert client.get("/readyz").json()["fronts_to_prepare_again"] == ["kfusion-7"]
    assert "Not offered now" in client.get("/fronts/kfusion-7/").content.decode()
    with pytest.raises(front_file.InvalidFrontError, match="prepare it again"):
        fronts.publish_again(draft)

    begun = run_to_the_end(steering.prepare(draft, "ann"))
    assert begun.prepares is not None
    fronts.publish(fronts.submit(begun.prepares))
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-8"


def test_a_device_over_http_gets_the_times_and_leaves_the_references_to_this_server(
    draft: FrontVersion,
) -> None:
    begun = preparation.create(draft)
    device = begun.reference_device
    tokens.issue_token(device, "ann")

    assert lease_api.begin_lease(device, b'{"lease_version": 2}') is None
    finish(services.pending_evaluations(begun))
    services.advance(begun.pk)
    lease = lease_api.begin_lease(device, b'{"lease_version": 2}')

    assert lease is not None
    assert lease.configuration == begun.evaluations.filter(phase=Phase.TIME).earliest("number").configuration


def test_steps_of_a_search_are_refused(draft: FrontVersion) -> None:
    begun = preparation.create(draft)

    assert [step.name for step in steering.available_steps(begun)] == ["pause", "cancel"]
    with pytest.raises(ValidationError, match="can only be paused, resumed and cancelled"):
        steering.take_step("raise", begun, "ann", "99")


def widen(begun: Exploration, name: str) -> None:
    """Let the devices differ by 9 mm on the point `name`."""
    change_references(begun, lambda found: found | {"band": 0.027, "largest_deviation": 0.009}, name)


def change_references(
    begun: Exploration, change: Callable[[dict[str, Any]], dict[str, Any]], name: str | None = None
) -> None:
    for row in begun.evaluations.filter(phase=Phase.REFERENCE):
        if name is None or row.label == name:
            assert row.reference is not None
            row.reference = change(row.reference)
            row.save()
