"""A front's protocol: what a draft refuses, and that no published one makes a submission answer 500."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest
from django.db import transaction
from django.test import Client
from django.utils import timezone
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from client_kit.delivery import manifest as client_manifest
from crowd.fronts import trajectories
from crowd.fronts.content import front_file, protocol
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.front import Content
from crowd.fronts.models import Configuration, FrontVersion
from crowd.fronts.publishing import services
from crowd.results import tasks
from crowd.results.intake import admission, checks
from tests.builders.crowds import Join
from tests.builders.documents import front_document, run_document, session_document, submission_document
from tests.builders.participant import Participant

TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=5,
)
NAMES = st.sampled_from(["default", "best", "accurate"])
USUAL = st.one_of(st.integers(-2, 120), st.floats(-1, 2), st.lists(NAMES, max_size=9))
KNOWN = st.sampled_from(protocol.MEMBERS)
KNOWN_MEMBERS = st.dictionaries(KNOWN, JSON | USUAL, min_size=1, max_size=3)
MEMBERS = st.dictionaries(KNOWN | TEXT, JSON | USUAL, min_size=1, max_size=3)


def with_protocol(pack: dict[str, Any], members: dict[str, Any]) -> dict[str, Any]:
    document = front_document(pack, "1")
    document["protocol"] |= members
    return document


def publish_unchecked(document: dict[str, Any], pack: dict[str, Any]) -> FrontVersion:
    """`document` as a published front, whatever its checks say."""
    content = msgspec.convert(document, Content)
    front = FrontVersion.objects.create(
        slug=content.slug,
        application=content.application,
        version=content.version,
        digest=front_file.digest(content),
        document=msgspec.json.encode(content.with_each(trajectories.named)).decode(),
        sequence=pack,
    )
    for position, point in enumerate(content.configurations):
        stored = point.trajectory and trajectories.store(point.trajectory)
        Configuration.objects.create(front=front, position=position, name=point.name, trajectory=stored)
    for state in ("in-review", "published"):
        front.refresh_from_db()  # PostgreSQL writes numbers in its own way
        front.state, front.published_at = state, timezone.now()
        front.save()
    return front


@pytest.mark.parametrize(
    ("members", "complaint"),
    [
        ({"version": 0}, "protocol.version: Expected `int` >= 2"),
        ({"version": 3}, "protocol.version: Expected `int` <= 2"),
        ({"version": True}, "protocol.version: Expected `int`, got `bool`"),
        ({"warmup_frames": -1}, "protocol.warmup_frames: Expected `int` >= 0"),
        ({"frames": 100.0}, "protocol.frames: Expected `int`, got `float`"),
        ({"frames": 10**30}, "protocol.frames: must be at most 9223372036854775807"),
        ({"first_counted_frame": 100}, "protocol.first_counted_frame: 100 is not below frames (100)"),
        ({"order": []}, "protocol.order: Expected `array` of length >= 2"),
        ({"order": ["default", "worst"]}, "protocol.order: 'worst' is not a configuration of this front"),
        ({"order": ["best", "accurate"]}, "protocol.order: default is missing"),
        ({"order": ["default", "default"]}, "protocol.order: it only names default"),
        ({"order": ["default", "best", "default"]}, "protocol.order: each configuration must appear equally"),
        ({"repeats": 3}, "protocol.repeats: order names each configuration 2 times: give 2 or a multiple"),
        ({"repeats": 26}, "protocol.repeats: 26 of 2 names are 52 runs: give at most 50"),
        ({"rest_seconds": -1}, "protocol.rest_seconds: Expected `float` >= 0"),
        ({"max_ate": "0.05"}, "protocol.max_ate: Expected `float`, got `str`"),
        ({"max_ate": 0}, "protocol.max_ate: Expected `float` > 0"),
        ({"temperature": 20}, "protocol.temperature: is unknown: a protocol has version, warmup_frames"),
    ],
)
def test_a_wrong_member_is_refused_by_name(
    db: None, pack: dict[str, Any], members: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(InvalidFrontError) as refused:
        services.create_draft(with_protocol(pack, members))

    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


def test_every_member_is_accepted_in_its_range(db: None, pack: dict[str, Any]) -> None:
    members = {
        "order": ["default", "best"],
        "repeats": 5,
        "rest_seconds": 1.5,
        "max_ate": 0.1,
    }

    draft = services.create_draft(with_protocol(pack, members))

    assert set(draft.content.protocol) == set(protocol.MEMBERS)
    assert {name: draft.content.protocol[name] for name in members} == members


def test_client_and_server_agree_on_the_runs_of_a_session() -> None:
    assert protocol.MAX_RUNS == checks.MAX_RUNS == client_manifest.MOST_RUNS


@contextmanager
def rolled_back() -> Iterator[None]:
    """Whatever is stored inside is gone afterwards: each example starts from the same database."""
    admission._released_fronts.clear()
    with transaction.atomic():
        yield
        transaction.set_rollback(True)


def assert_submissions_are_answered(participant: Participant, front: FrontVersion) -> None:
    frames, version = (front.content.protocol.get(name) for name in ("frames", "version"))
    count = frames if type(frames) is int and 0 < frames < 200 else 100
    times = {"frame_us": [10_000] * count, "stages_us": None, "tracked": None}
    for number in {0, 1, version if type(version) is int else 1}:
        runs = [run_document("default", 0, 0, 0, **times), run_document("best", 0, 1, 0, **times)]
        session = session_document(front.slug, runs=runs, protocol_version=number)
        for path in ("/submissions:validate", "/submissions"):
            assert participant.submit(submission_document(session), path=path).status_code < 500


MANY = settings(suppress_health_check=list(HealthCheck), max_examples=50)


@pytest.mark.slow
@MANY
@given(members=MEMBERS)
@example(members={"max_ate": "0.05"})
@example(members={"version": 1})
@example(members={"rest_seconds": 1})
def test_what_a_draft_accepts_can_be_measured_and_sent(
    db: None, join: Join, pack: dict[str, Any], members: dict[str, Any]
) -> None:
    with rolled_back():
        try:
            draft = services.create_draft(with_protocol(pack, members))
        except InvalidFrontError:
            return
        services.publish(services.submit(draft))

        assert_submissions_are_answered(join(), draft)
        client_manifest.Manifest.parse(Client().get("/api/v1/manifest").json())


@pytest.mark.slow
@settings(MANY, max_examples=15)  # each asks for every page
@given(members=KNOWN_MEMBERS)
@example(members={"max_ate": "0.05"})
@example(members={"frames": None})
@example(members={"first_counted_frame": 1.5})
@example(members={"first_counted_frame": 99})
def test_a_published_front_that_no_check_has_seen_makes_nothing_fail(
    db: None, join: Join, pack: dict[str, Any], members: dict[str, Any]
) -> None:
    with rolled_back():
        front = publish_unchecked(with_protocol(pack, members), pack)

        assert_submissions_are_answered(join(), front)
        tasks.sweep()
        for address in ("/fronts/kfusion-1/", "/figures/fronts/kfusion-1.json", "/", "/about/"):
            assert Client().get(address).status_code == 200


def test_a_front_whose_protocol_is_damaged_refuses_runs_with_a_code(
    db: None, join: Join, pack: dict[str, Any]
) -> None:
    front = publish_unchecked(with_protocol(pack, {"max_ate": "0.05"}), pack)

    answer = join().submit(submission_document(session_document(front.slug)))

    assert answer.status_code == 422
    assert answer.json()["code"] == "unknown_protocol_version"
    assert {item["code"] for item in answer.json()["items"]} == {"unknown_protocol_version"}
    assert "the protocol of kfusion-1 is damaged" in answer.json()["detail"]
