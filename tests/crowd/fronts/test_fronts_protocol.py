"""A front's protocol: what a draft refuses, and that what it accepts can be measured and sent."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest
from django.db import transaction
from django.test import Client
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from client_kit.delivery import manifest as client_manifest
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services
from crowd.results.intake import admission
from tests.builders.crowds import Join
from tests.builders.documents import front_document, run_document, session_document, submission_document
from tests.builders.participant import Participant
from wire.front import Protocol

TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=5,
)
NAMES = st.sampled_from(["default", "best", "accurate"])
USUAL = st.one_of(st.integers(-2, 120), st.floats(-1, 2), st.lists(NAMES, max_size=9))
KNOWN = st.sampled_from(Protocol.__struct_fields__)
MEMBERS = st.dictionaries(KNOWN | TEXT, JSON | USUAL, min_size=1, max_size=3)


def with_protocol(pack: dict[str, Any], members: dict[str, Any]) -> dict[str, Any]:
    document = front_document(pack, "1")
    document["protocol"] |= members
    return document


@pytest.mark.parametrize(
    ("members", "complaint"),
    [
        ({"version": 0}, "protocol.version: Expected `int` >= 1"),
        ({"version": 3}, "protocol.version: 3 is unknown here"),
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
        ({"rest_seconds": -1}, "protocol.rest_seconds: Expected `int` >= 0"),
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
        "order": ("default", "best"),
        "repeats": 5,
        "rest_seconds": 1.5,
        "max_ate": 0.1,
    }

    draft = services.create_draft(with_protocol(pack, members))

    stored = msgspec.to_builtins(draft.content.protocol)
    assert set(stored) == set(Protocol.__struct_fields__)
    assert {name: stored[name] for name in members} == members


@contextmanager
def rolled_back() -> Iterator[None]:
    """Whatever is stored inside is gone afterwards: each example starts from the same database."""
    admission._released_fronts.clear()
    with transaction.atomic():
        yield
        transaction.set_rollback(True)


def assert_submissions_are_answered(participant: Participant, front: FrontVersion) -> None:
    frames, version = front.content.protocol.frames, front.content.protocol.version
    times = {"frame_us": [10_000] * min(frames, 200), "stages_us": None, "tracked": None}
    for number in (0, version):
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
