"""A new exploration in the administration: its space from a file, and how long it will take."""

import json
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.test import Client
from django.urls import reverse

from crowd.explorations import services, space_choice
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.outcomes import duration
from crowd.fronts.publishing.services import publish_content
from slam.datasets import open_sequence
from tests.builders.documents import front_document, write_pack
from tests.builders.explorations import SPACE, run_to_the_end
from tests.crowd.roles import browser_of
from tests.dashboard.reading import text
from tests.explorations.test_administration import ADD, wish

Estimate = Callable[..., Any]


@pytest.fixture
def estimated(admin_client: Client, unsaved: Exploration) -> Estimate:
    """Fills in the form with changes and asks for the duration."""

    def asked(**changes: Any) -> Any:
        return admin_client.post(reverse(ADD), wish(unsaved, **changes) | {"_estimate": "1"})

    return asked


def file(space: Any, name: str = "mine.json") -> SimpleUploadedFile:
    content = space if isinstance(space, bytes) else json.dumps(space).encode()
    return SimpleUploadedFile(name, content)


def taking(exploration: Exploration, seconds: float) -> None:
    """Let each measurement of `exploration` have taken `seconds`."""
    for row in exploration.evaluations.filter(state=Evaluation.State.DONE):
        assert row.finished_at is not None
        Evaluation.objects.filter(pk=row.pk).update(started_at=row.finished_at - timedelta(seconds=seconds))


def test_an_estimate_counts_what_will_be_measured(unsaved: Exploration) -> None:
    unsaved.objectives = ["ate_max", "runtime_ratio"]
    parts = duration.estimate(unsaved).parts
    prepared = len(services.create(unsaved).evaluations.all())

    assert [(part.measurements, part.frames) for part in parts] == [
        (prepared, 12),
        (6, 12),
        (2, 12),  # two batches of 4 for a budget of 6
        ((3 + prepared) * 2, 12),
    ]
    run_to_the_end(unsaved)
    measured = unsaved.evaluations.count()
    assert measured <= sum(part.measurements for part in parts)


def test_a_short_search_still_repeats_over_whole_sequences(several: Exploration) -> None:
    several.frames = 11

    parts = duration.estimate(several).parts

    assert [part.frames for part in parts] == [33, 33, 4 * 12]


def test_the_duration_follows_from_what_the_device_measured_before(unsaved: Exploration) -> None:
    earlier = run_to_the_end(services.create(services.clone(unsaved)))
    taking(earlier, 6.0)
    unsaved.budget = 12

    estimate = duration.estimate(unsaved)

    assert estimate.seconds == pytest.approx(6.0 * estimate.measurements)
    assert not estimate.least
    assert f"exploration {earlier.pk}" in estimate.source
    assert "500 ms a frame" in estimate.source
    unsaved.reference_device.machines = 3
    assert duration.estimate(unsaved).seconds == pytest.approx(2.0 * estimate.measurements)


@pytest.mark.parametrize("change", ["device", "backend", "application", "sequence"])
def test_measurements_of_something_else_say_nothing(unsaved: Exploration, change: str) -> None:
    earlier = run_to_the_end(services.create(services.clone(unsaved)))
    taking(earlier, 6.0)
    if change == "device":
        unsaved.reference_device = ReferenceDevice.objects.create(name="other", queue="other")
    elif change == "backend":
        unsaved.reference_device.backend = "webgpu"
    elif change == "application":
        Exploration.objects.update(application="elasticfusion")
    else:
        Exploration.objects.update(sequence="not here")

    estimate = duration.estimate(unsaved)

    assert estimate.seconds is None
    assert "was never measured on" in estimate.source


def test_a_front_gives_the_least_duration(unsaved: Exploration, own_data_folder: Path, settings: Any) -> None:
    pack = write_pack(own_data_folder / "sequences")
    settings.FRONTRUNNER_SEQUENCES = [*settings.FRONTRUNNER_SEQUENCES, own_data_folder / "sequences"]
    provenance = {"reference_device": "bench", "device": "Bench CPU"}
    publish_content(front_document(pack, provenance=provenance))

    estimate = duration.estimate(unsaved)

    frames = sum(part.measurements * part.frames for part in estimate.parts)
    assert estimate.least
    assert estimate.seconds == pytest.approx(0.08 * frames)
    assert "front kfusion-test" in estimate.source
    assert "Bench CPU" in estimate.source


def test_the_page_shows_the_estimate_and_stores_nothing(estimated: Estimate, unsaved: Exploration) -> None:
    earlier = run_to_the_end(services.create(services.clone(unsaved)))
    taking(earlier, 6.0)

    page = text(estimated(budget="50"))

    assert "Searched configurations 50 12" in page
    assert "ms a frame on average" in page
    assert "1,800,000 configurations" in page
    assert Exploration.objects.count() == 1
    assert 'value="50"' in estimated(budget="50").content.decode()


def test_what_is_not_known_is_said(estimated: Estimate) -> None:
    page = text(estimated())

    assert "The duration is unknown : kfusion was never measured on bench." in page
    assert "All 27 unknown" in page


def test_no_duration_is_estimated_for_what_cannot_run(estimated: Estimate) -> None:
    answer = estimated(budget="0")

    assert "0 is too small: give 1 or more" in answer.content.decode()
    assert "estimate" not in answer.context


def test_only_those_who_may_add_explorations_estimate(unsaved: Exploration) -> None:
    answer = browser_of("").post(reverse(ADD), wish(unsaved) | {"_estimate": "1"})

    assert answer.status_code == 403


def test_a_space_from_a_file_survives_the_estimate_and_is_searched(
    admin_client: Client, estimated: Estimate, unsaved: Exploration, unread_queues: None
) -> None:
    shown = estimated(space_file=file(SPACE), system="kfusion")
    form = shown.context["adminform"].form
    assert "The space has 4 parameters, 72 configurations." in text(shown)
    assert '<option value="uploaded" selected>from the file</option>' in str(form["design_space"])

    kept = {name: form[name].value() for name in ("design_space", "space_uploaded", "system")}
    answer = admin_client.post(reverse(ADD), wish(unsaved, **kept))

    assert answer.status_code == 302, answer.context["errors"]
    created = Exploration.objects.get()
    assert (created.application, created.space) == ("kfusion", SPACE)


def test_a_space_that_ships_can_be_chosen_again_after_a_file(estimated: Estimate) -> None:
    form = estimated(space_file=file(SPACE), system="kfusion").context["adminform"].form

    again = estimated(space_uploaded=form["space_uploaded"].value(), design_space="kfusion")

    assert "1,800,000 configurations" in text(again)


def test_the_system_of_a_file_is_in_the_name_of_its_space(estimated: Estimate) -> None:
    answer = estimated(space_file=file(SPACE | {"name": "kfusion-small"}))

    assert answer.context["adminform"].form.instance.application == "kfusion"
    assert "estimate" in answer.context


NO_SPACES: list[tuple[Any, str, str]] = [
    (b"{", "kfusion", "mine.json is not JSON"),
    (b"[" * 100_000, "kfusion", "mine.json is not JSON"),
    (b"\xff\xfe\x00", "kfusion", "mine.json is not JSON"),
    (b"[]", "kfusion", "mine.json: a space is"),
    (b" " * (space_choice.LARGEST_FILE_BYTES + 1), "kfusion", "a space has 262144 at most"),
    ({"name": "mine", "parameters": [], "colour": 1}, "kfusion", "unknown field &#x27;colour&#x27;"),
    (SPACE, "", "does not say which system runs it: choose kfusion or elasticfusion"),
    (SPACE, "elasticfusion", "elasticfusion cannot run the space &#x27;small&#x27;"),
    (
        {"name": "kfusion", "parameters": [{"name": "speed", "type": "ordinal", "values": [1, 2]}]},
        "",
        "kfusion cannot run the space",
    ),
]


@pytest.mark.slow
def test_a_file_that_is_no_space_is_refused_with_what_is_wrong(
    estimated: Estimate, subtests: pytest.Subtests
) -> None:
    for space, system, complaint in NO_SPACES:
        with subtests.test(complaint):
            answer = estimated(space_file=file(space), system=system)

            assert answer.status_code == 200
            assert complaint in str(answer.context["errors"])
            assert "estimate" not in answer.context


def test_a_shipped_space_is_refused_for_another_system(estimated: Estimate) -> None:
    page = estimated(system="elasticfusion").content.decode()

    assert "elasticfusion cannot run the space &#x27;kfusion&#x27;" in page


def test_each_shipped_space_can_be_run_by_its_system(db: None) -> None:
    offered = [choice for choice, _ in space_choice.space_choices()]

    assert {"kfusion", "elasticfusion", "elasticfusion-loops"} <= set(offered)
    for choice in offered:
        space_choice.check_fits(*space_choice.space_of_choice(choice))


def test_a_sequence_that_is_gone_is_refused(
    admin_client: Client, unsaved: Exploration, tiny_pack: Any, settings: Any
) -> None:
    filled = wish(unsaved) | {"_estimate": "1"}
    assert open_sequence(tiny_pack).sha256 in filled["pack"]
    settings.FRONTRUNNER_SEQUENCES = []

    page = admin_client.post(reverse(ADD), filled).content.decode()

    assert "Select a valid choice" in page
