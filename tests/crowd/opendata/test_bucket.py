"""What only a bucket does: earlier versions of objects, requests for ranges, an outage."""

from typing import Any

import pyarrow.parquet
import pytest
from django.test import Client

from crowd.results.opendata import exports, storing
from tests.builders.documents import submission_document
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.crowd.exported import all_files

pytestmark = pytest.mark.slow
ADDRESS = "/data/latest/runs.parquet"


@pytest.fixture
def place() -> None:
    """Not both places: a bucket, which each of these tests asks for."""


def versions(bucket: Any) -> set[str]:
    """The names of all objects that a version or a mark of deletion is left of."""
    return {version.object_key.rpartition("/")[2] for version in bucket.object_versions.all()}


def test_an_erasure_leaves_no_earlier_version(bucket: Any, client: Client, participant: Participant) -> None:
    session = measure(participant)
    exports.create_export()
    before = versions(bucket)

    participant.delete(f"/me/runs/{session['runs'][0]['id']}")
    assert exports.rewrite_all()

    assert versions(bucket) == all_files() != before


def test_a_file_is_read_from_any_place(bucket: Any, participant: Participant) -> None:
    participant.submit(submission_document())
    export = exports.create_export()
    stored = export.files.get(name="runs.parquet").stored

    with storing.open_stored(stored) as file:
        assert pyarrow.parquet.read_schema(file).names[0] == "run"
        file.seek(-4, 2)
        assert file.read() == b"PAR1"
        file.seek(0)
        assert file.read(4) == b"PAR1"


def test_while_the_bucket_does_not_answer_a_reader_is_told_so(
    bucket: Any, client: Client, participant: Participant, monkeypatch: pytest.MonkeyPatch, settings: Any
) -> None:
    participant.submit(submission_document())
    exports.create_export()
    etag = client.get(ADDRESS).headers["ETag"]
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    settings.STORAGES = dict(settings.STORAGES)  # Django forgets its connections
    client.raise_request_exception = False

    answer = client.get(ADDRESS)

    assert (answer.status_code, answer.json()["code"]) == (503, "files_unavailable")
    assert "Retry-After" in answer.headers
    # What a reader has needs no bucket.
    assert client.get(ADDRESS, headers={"If-None-Match": etag}).status_code == 304
    with pytest.raises(OSError, match="the bucket"):
        exports.create_export()
