"""A run's errors and its deviation bind each other, because the first poses are aligned."""

import json
from typing import Any

import numpy as np
import pytest
from django.conf import LazySettings

from crowd.fronts import sequences, trajectories
from crowd.fronts.content import front_file
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services
from slam.datasets.formats.pack import Pack
from slam.trajectories.trajectory import absolute_trajectory_error
from tests.builders.crowds import Join
from tests.builders.documents import (
    elastic_front_document,
    front_document,
    run_document,
    session_document,
    submission_document,
)
from tests.builders.participant import Participant
from tests.crowd.refusals import nothing_is_stored, problem
from tests.shipped import KFUSION, LIVING_ROOM
from wire.front import Errors
from wire.protocol import ERROR_ROUNDING

# Of the default of the front that ships, and of the client in Go that left out the first rotation.
RIGHT = {"ate_max": 0.00159, "ate_mean": 0.00089, "ate_rmse": 0.00096}
WITHOUT_ROTATION = {"ate_max": 0.0482, "ate_mean": 0.0214, "ate_rmse": 0.0255}
FORGOTTEN = "error_contradicts_deviation"


@pytest.fixture
def shipped(db: None, settings: LazySettings) -> FrontVersion:
    """The front that ships, published with its sequence."""
    settings.FRONTRUNNER_SEQUENCES = [LIVING_ROOM.parent]
    sequences.open_pack.cache_clear()
    return services.publish_content(front_file.read(KFUSION))[0]


@pytest.fixture
def author(shipped: FrontVersion, join: Join) -> Participant:
    """Someone who writes a client for the front that ships."""
    return join()


def sent(front: FrontVersion, **errors: float) -> dict[str, Any]:
    """A submission of one run of the default with these errors."""
    run = run_document("default", 0, 0, 10_000, **errors)
    return submission_document(session_document(front.slug, runs=[run]))


def test_positions_without_the_first_rotation_are_refused_by_name(
    shipped: FrontVersion, author: Participant
) -> None:
    response = author.submit(sent(shipped, **WITHOUT_ROTATION, deviation=0.0))

    assert problem(response) == (422, FORGOTTEN, "sessions[0].runs[0].ate_max")
    assert "0.0482 m, that of the reference trajectory 0.00159 m" in response.json()["detail"]
    assert "Rotate the positions into the frame of the first true pose" in response.json()["detail"]
    assert nothing_is_stored()


def test_the_errors_of_the_reference_itself_are_taken(shipped: FrontVersion, author: Participant) -> None:
    assert author.submit(sent(shipped, **RIGHT, deviation=0.0)).status_code == 202


@pytest.mark.parametrize("field", RIGHT)
def test_each_error_may_differ_by_twice_the_deviation(
    shipped: FrontVersion, author: Participant, field: str
) -> None:
    deviation = 0.0002
    near, far = (2 * deviation + ERROR_ROUNDING + more for more in (-2e-5, 2e-5))
    # The other errors stay in order.
    others = RIGHT if field != "ate_mean" else RIGHT | {"ate_rmse": RIGHT["ate_rmse"] + 4e-4}

    taken = author.submit(sent(shipped, **others | {field: RIGHT[field] + near}, deviation=deviation))
    refused = author.submit(sent(shipped, **others | {field: RIGHT[field] + far}, deviation=deviation))

    assert taken.status_code == 202
    assert problem(refused) == (422, FORGOTTEN, f"sessions[0].runs[0].{field}")


def test_the_manifest_has_the_errors_to_reach_and_the_front_s_file_does_not(
    shipped: FrontVersion, author: Participant
) -> None:
    manifest = author.get("/manifest").json()
    default = manifest["configurations"][0]["reference_ate"]

    assert default == pytest.approx(RIGHT, abs=5e-6)
    assert all("reference_ate" in point for point in manifest["configurations"])
    assert "reference_ate" not in json.dumps(json.loads(KFUSION.read_text()))
    services.check_digest(services.selectors.read(shipped))


def test_no_two_close_trajectories_have_errors_farther_apart() -> None:
    """The rule is a theorem: random truths, references and runs never break it."""
    random = np.random.default_rng(0)
    for _ in range(200):
        truth = np.tile(np.eye(4), (20, 1, 1))
        truth[:, :3, :3] = np.linalg.qr(random.normal(size=(20, 3, 3)))[0]
        truth[:, :3, :3] *= np.linalg.det(truth[:, :3, :3])[:, None, None]
        truth[:, :3, 3] = random.normal(size=(20, 3))
        reference = random.normal(size=(20, 3))
        run = reference + random.normal(size=(20, 3)) * random.uniform(0, 0.5)
        deviation = np.linalg.norm(run - reference, axis=1).max()

        ates = []
        for positions in (reference, run):
            poses = np.tile(np.eye(4), (20, 1, 1))
            poses[:, :3, 3] = positions
            ates.append(absolute_trajectory_error(poses, truth))

        for name in ("max", "mean", "rmse"):
            assert abs(getattr(ates[0], name) - getattr(ates[1], name)) <= 2 * deviation + 1e-12


def test_errors_are_those_of_the_positions_after_the_first_rotation() -> None:
    truth = Pack(LIVING_ROOM).truth
    assert truth is not None
    start, rotation = np.array([2.4, 2.3, 0.5]), truth[0, :3, :3]
    exact = start + (truth[:, :3, 3] - truth[0, :3, 3]) @ rotation
    aside = exact + np.array([0.003, 0.0, 0.0]) * (np.arange(len(exact)) > 0)[:, None]

    assert trajectories.errors(exact.tolist(), truth) == Errors(0, 0, 0)
    assert trajectories.errors(aside.tolist(), truth) == Errors(0.003, 0.00297, 0.002985)


def test_without_the_first_true_pose_nothing_is_known() -> None:
    truth = Pack(LIVING_ROOM).truth
    assert truth is not None
    unknown = truth.copy()
    unknown[0] = np.nan

    for poses in (None, unknown):
        assert trajectories.errors(((0.0, 0.0, 0.0),) * len(truth), poses) is None


def test_a_system_that_moves_its_first_pose_has_no_errors_that_bind(db: None, settings: LazySettings) -> None:
    settings.FRONTRUNNER_SEQUENCES = [LIVING_ROOM.parent]
    sequences.open_pack.cache_clear()

    moving, fixed = (
        services.create_draft(document)
        for document in (
            elastic_front_document(LIVING_ROOM),
            front_document(json.loads((LIVING_ROOM / "pack.json").read_text())),
        )
    )

    assert {point.reference_ate for point in moving.content.every} == {None}
    assert None not in {point.reference_ate for point in fixed.content.every}
