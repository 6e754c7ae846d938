"""What a process keeps of its answers is never shown once the data behind it changed."""

import pytest
from django.test import Client

from crowd.devices import revision
from crowd.devices.models import DeviceModel
from crowd.results.models import MeasurementSession
from crowd.results.reading.versioned_cache import VersionedCache
from tests.builders.crowds import Join
from tests.builders.documents import device_document, session_document, submission_document
from tests.builders.participant import API, Participant

PATHS = ("/speedups", "/speedups?since=2020-01-01", "/devices")


def names(client: Client, path: str) -> list[str]:
    return sorted(row["name"] for row in client.get(f"{API}{path}").json()["results"])


def test_what_is_kept_is_made_anew_for_another_version() -> None:
    kept: VersionedCache[list[int]] = VersionedCache(2)
    first = kept.get(lambda: "1", "a", list)

    assert kept.get(lambda: "1", "a", list) is first
    assert kept.get(lambda: "2", "a", list) is not first


def test_what_was_read_while_the_version_changed_is_not_kept() -> None:
    kept: VersionedCache[list[int]] = VersionedCache(2)
    versions = iter(["1", "2", "1", "1"])
    first = kept.get(lambda: next(versions), "a", list)

    assert kept.get(lambda: next(versions), "a", list) is not first


def test_the_answer_asked_for_longest_ago_goes_first() -> None:
    kept: VersionedCache[list[int]] = VersionedCache(2)
    first, second = (kept.get(lambda: "1", key, list) for key in "ab")
    assert kept.get(lambda: "1", "a", list) is first
    kept.get(lambda: "1", "c", list)

    assert kept.get(lambda: "1", "a", list) is first
    assert kept.get(lambda: "1", "b", list) is not second


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
def test_new_sessions_names_and_erasures_are_seen_at_once(
    participant: Participant, join: Join, client: Client, path: str
) -> None:
    participant.submit(submission_document())
    assert names(client, path) == ["Pixel 8"]

    other = join()
    other.submit(submission_document(device=device_document("Pixel 9")))
    assert names(client, path) == ["Pixel 8", "Pixel 9"]

    DeviceModel.objects.filter(slug="google-pixel-9").update(name="Pixel Nine")
    revision.bump()
    assert names(client, path) == ["Pixel 8", "Pixel Nine"]

    participant.submit(submission_document(session_document(best_us=20_000)))
    shown = {row["name"]: row for row in client.get(f"{API}{path}").json()["results"]}
    assert shown["Pixel 8"]["sessions"] == MeasurementSession.objects.filter(device__name="Pixel 8").count()

    assert other.client.delete(f"{API}/me", headers=other.headers).status_code == 204
    assert names(client, path) == ["Pixel 8"]
