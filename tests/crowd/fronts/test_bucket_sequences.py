"""Sequences of a bucket: copied to each machine, checked, and served from there."""

import logging
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.fronts import sequences
from crowd.fronts.publishing.services import publish_content
from tests.builders.documents import front_document, write_pack
from tests.crowd.buckets import upload

pytestmark = pytest.mark.slow
CHUNKS = (b"one", b"two")


@pytest.fixture
def uploaded(bucket: Any, tmp_path: Path) -> dict[str, Any]:
    """The description of a pack that only the bucket has."""
    description = write_pack(tmp_path, chunks=CHUNKS)
    upload(tmp_path / description["name"], bucket, f"crowd/sequences/{description['name']}")
    return description


def addresses(description: dict[str, Any]) -> list[str]:
    return [f"/sequences/{chunk['sha256']}" for chunk in description["chunks"]]


def test_a_front_is_published_and_served_from_a_copy(
    client: Client,
    db: None,
    uploaded: dict[str, Any],
    bucket: Any,
    settings: Any,
) -> None:
    publish_content(front_document(uploaded))

    # Nothing is asked of the bucket any more.
    bucket.objects.all().delete()
    assert sequences.find_verified(uploaded["name"], uploaded["sha256"]) == uploaded
    assert [client.get(each).getvalue() for each in addresses(uploaded)] == list(CHUNKS)
    copies = settings.FRONTRUNNER_VAR / "fetched"
    assert [pack.name for pack in copies.iterdir()] == [uploaded["name"]]


def test_a_machine_without_a_copy_streams_from_the_bucket(
    client: Client, db: None, uploaded: dict[str, Any]
) -> None:
    answers = [client.get(each) for each in addresses(uploaded)]

    assert [answer.getvalue() for answer in answers] == list(CHUNKS)
    assert [answer.headers["Content-Length"] for answer in answers] == ["3", "3"]
    assert client.get(f"/sequences/{'0' * 64}").status_code == 404


def test_a_new_pack_of_the_same_name_replaces_the_copy(
    uploaded: dict[str, Any],
    bucket: Any,
    tmp_path: Path,
) -> None:
    list(sequences.packs())
    other = write_pack(tmp_path / "other", chunks=(b"three",))
    upload(tmp_path / "other" / other["name"], bucket, f"crowd/sequences/{other['name']}")

    assert sequences.find_verified(other["name"], other["sha256"]) == other
    [pack] = sequences.packs()
    assert [chunk.read_bytes() for chunk in (pack / "chunks").iterdir()] == [b"three"]


def test_a_damaged_pack_of_the_bucket_is_not_copied(
    uploaded: dict[str, Any],
    bucket: Any,
    caplog: pytest.LogCaptureFixture,
) -> None:
    damaged = uploaded["chunks"][1]["sha256"]
    bucket.Object(f"crowd/sequences/{uploaded['name']}/chunks/{damaged}").put(Body=b"tow")

    with caplog.at_level(logging.WARNING), pytest.raises(sequences.SequenceError, match="found: none"):
        sequences.find_verified(uploaded["name"], uploaded["sha256"])

    assert f"{damaged} does not match its digest" in caplog.text


def test_what_is_no_pack_stops_no_other_one(
    uploaded: dict[str, Any], bucket: Any, caplog: pytest.LogCaptureFixture
) -> None:
    for content in (b"[]", b'{"chunks": null}', b'{"chunks": [{"sha256": "../x", "bytes": 1}]}'):
        caplog.clear()
        bucket.Object("crowd/sequences/another/pack.json").put(Body=content)

        assert [pack.name for pack in sequences.packs()] == [uploaded["name"]]
        assert "the sequence another of the bucket cannot be copied" in caplog.text


def test_copies_are_used_while_the_bucket_does_not_answer(
    client: Client,
    db: None,
    uploaded: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
    settings: Any,
) -> None:
    assert len(list(sequences.packs())) == 1
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    settings.STORAGES = dict(settings.STORAGES)  # Django forgets its connections

    assert sequences.find_verified(uploaded["name"], uploaded["sha256"]) == uploaded
    assert client.get(addresses(uploaded)[0]).getvalue() == CHUNKS[0]
    client.raise_request_exception = False
    unknown = client.get(f"/sequences/{'0' * 64}")
    assert (unknown.status_code, unknown.json()["code"]) == (503, "files_unavailable")
    assert "Retry-After" in unknown.headers
