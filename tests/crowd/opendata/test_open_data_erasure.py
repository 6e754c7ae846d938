"""What is erased disappears from the open data at once, and everything else stays available."""

import hashlib
import io
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event
from typing import Any

import pyarrow.parquet
import pytest
from celery.signals import task_prerun
from django.db import connection
from django.test import Client

from crowd.results import marking
from crowd.results.marking import DIGESTS
from crowd.results.models import Export, MeasurementSession, Run, StoredFile
from crowd.results.opendata import exports, reading, storing, writing
from crowd.results.opendata.tables import TABLES
from crowd.results.tasks import rewrite_exports
from tests.builders.crowds import Join, send
from tests.builders.documents import run_document, session_document, submission_document
from tests.builders.measuring import measure
from tests.builders.participant import API, Participant
from tests.crowd.buckets import IN_BOTH_PLACES
from tests.crowd.exported import aged_export, all_files, delete


def address(name: str, export: Export | None = None) -> str:
    return f"/data/{export.name if export else 'latest'}/{name}"


def rows(client: Client, name: str, export: Export | None = None) -> list[dict[str, Any]]:
    """Rows of the Parquet file `name` as it is served now."""
    answer = client.get(address(f"{name}.parquet", export))
    assert answer.status_code == 200, answer.getvalue()
    table: list[dict[str, Any]] = pyarrow.parquet.read_table(io.BytesIO(answer.getvalue())).to_pylist()
    return table


def digests(export: Export) -> dict[str, str]:
    return dict(export.files.values_list("name", "stored__sha256"))


@contextmanager
def locked_elsewhere() -> Iterator[None]:
    """The lock of the exports is held by another thread, with a connection of its own."""
    held, ended = Event(), Event()

    def hold() -> None:
        with storing.exports_lock(0) as locked:
            assert locked
            held.set()
            ended.wait()
        connection.close()

    with ThreadPoolExecutor(1) as elsewhere:
        holding = elsewhere.submit(hold)
        assert held.wait(60)
        try:
            yield
        finally:
            ended.set()
        holding.result()


def exported(participant: Participant) -> dict[str, Any]:
    """The session that `participant` sends before an export is made."""
    session = measure(participant)
    exports.create_export()
    return session


@pytest.fixture
def in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every run is a part of its own, and every session in the other tables."""
    monkeypatch.setattr(reading, "BLOCK_BYTES", 1)
    monkeypatch.setattr(writing, "PART_BYTES", 1)


@IN_BOTH_PLACES
def test_an_erased_run_is_gone_from_every_export_and_nothing_else_is(
    client: Client, participant: Participant, join: Join
) -> None:
    session = measure(participant)
    join().submit(submission_document())
    earlier, newest = aged_export(2), exports.create_export()
    unchanged = digests(newest)["configurations.parquet"]
    erased, *left = [run["id"] for run in session["runs"]]

    participant.delete(f"/me/runs/{erased}")

    for export in (earlier, newest):
        remaining = [row["run"] for row in rows(client, "runs", export)]
        assert erased not in remaining
        assert set(left) < set(remaining)
        assert len(remaining) == 7
        assert len(rows(client, "sessions", export)) == 2
        (stone,) = rows(client, "tombstones", export)
        assert stone["id_sha256"] == hashlib.sha256(erased.encode()).hexdigest()
        assert (stone["kind"], stone["single"]) == ("run", True)
    assert digests(newest)["configurations.parquet"] == unchanged
    assert client.get(address("runs.csv.gz")).status_code == 200


@pytest.mark.parametrize("large", [False, True], ids=["a device", "a large device"])
def test_summaries_and_figures_forget_an_erased_run(
    client: Client, participant: Participant, monkeypatch: pytest.MonkeyPatch, large: bool
) -> None:
    session = session_document()
    session["runs"][1] |= {"frame_us": [5_000] * 100, "stages_us": {}}
    send(participant, session)
    exports.create_export()
    assert rows(client, "summaries")[0]["pairs"] == 2
    if large:
        monkeypatch.setattr("crowd.results.figures.sessions.LARGE_DEVICE_SESSIONS", 0)

    participant.delete(f"/me/runs/{session['runs'][1]['id']}")

    (summary,), (figure,) = rows(client, "summaries"), rows(client, "figures")
    assert (summary["pairs"], summary["speedup"]) == (1, pytest.approx(8.0))
    assert figure["speedup"] == pytest.approx(8.0)


def test_an_erased_participant_is_gone_from_every_table(
    client: Client, participant: Participant, join: Join
) -> None:
    measure(participant, best_us=5_000)
    staying = measure(join(), best_us=20_000)
    exports.create_export()

    participant.delete("/me")

    assert [row["session"] for row in rows(client, "sessions")] == [staying["id"]]
    assert {row["session"] for row in rows(client, "runs")} == {staying["id"]}
    assert [row["session"] for row in rows(client, "summaries")] == [staying["id"]]
    assert rows(client, "figures")[0]["speedup"] == pytest.approx(4.0)
    assert rows(client, "devices")[0]["installations"] == 1
    assert [stone["single"] for stone in rows(client, "tombstones")] == [False] * 6


@IN_BOTH_PLACES
def test_digests_everywhere_are_those_of_the_rewritten_files(
    client: Client, participant: Participant
) -> None:
    session = exported(participant)

    participant.delete(f"/me/runs/{session['runs'][0]['id']}")

    sums = client.get(address("SHA256SUMS")).getvalue().decode().splitlines()
    listed = client.get(f"{API}/exports").json()["results"][0]["files"]
    package = json.loads(client.get(address("datapackage.json")).getvalue())
    assert not any(file["stale"] for file in listed)
    contents = {file["name"]: client.get(file["url"]).getvalue() for file in listed}
    actual = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    assert {file["name"]: file["sha256"] for file in listed} == actual
    assert {file["name"]: file["bytes"] for file in listed} == {k: len(v) for k, v in contents.items()}
    del actual["SHA256SUMS"]
    assert sorted(sums) == sorted(f"{digest}  {name}" for name, digest in actual.items())
    for resource in package["resources"]:
        assert resource["hash"] == f"sha256:{actual[resource['path']]}"


def test_installations_keep_their_names_in_a_rewritten_file(
    client: Client, participant: Participant, join: Join
) -> None:
    leaving = join()
    for each in (participant, leaving, participant):
        each.submit(submission_document())
    exports.create_export()
    first, _, third = [row["installation"] for row in rows(client, "sessions")]

    leaving.delete("/me")

    assert [row["installation"] for row in rows(client, "sessions")] == [first, third]
    assert first == third


@pytest.mark.slow
def test_a_large_table_has_numbered_parts(client: Client, participant: Participant, in_parts: None) -> None:
    for _ in range(3):
        participant.submit(submission_document())

    exports.create_export()

    names = [file["name"] for file in client.get(f"{API}/exports").json()["results"][0]["files"]]
    parts = [f"runs-{part}.parquet" for part in range(1, 13)]
    assert [name for name in names if name.startswith("runs") and name.endswith("parquet")] == parts
    stored = [str(run.uuid) for run in Run.objects.order_by("pk")]
    assert [row["run"] for part in range(1, 13) for row in rows(client, f"runs-{part}")] == stored
    plain = client.get(address("runs.parquet"))
    assert (plain.status_code, plain.json()["code"]) == (404, "not_found")
    assert "runs-1.parquet to runs-12.parquet" in plain.json()["detail"]
    assert "/api/v1/exports" in plain.json()["detail"]
    page = client.get("/data/").content.decode()
    assert all(f'href="/data/latest/{part}"' in page for part in parts)


def test_a_part_never_divides_a_session_and_is_bounded_uncompressed_too(
    client: Client, participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What rewriting a part costs grows with its values, not with its file."""
    for _ in range(3):
        measure(participant, samples=[{"t": float(second)} for second in range(50)])
    monkeypatch.setattr(reading, "BLOCK_ROWS", 3)
    with monkeypatch.context() as patched:
        patched.setattr(writing, "PART_BYTES", 1)
        exports.create_export()
    assert [len(rows(client, f"run_states-{part}")) for part in (1, 2, 3)] == [4, 4, 4]
    assert [len(rows(client, f"runs-{part}")) for part in (1, 2, 3, 4)] == [3, 3, 3, 3]

    Export.objects.all().delete()
    exports.clean_up()
    monkeypatch.setattr(reading, "BLOCK_BYTES", 1)
    monkeypatch.setattr(writing, "UNCOMPRESSED_BYTES", 1_000)
    exports.create_export()
    parts = StoredFile.objects.filter(table="sessions", format="parquet")
    assert [file.rows for file in parts] == [1, 1, 1]


@pytest.mark.slow
def test_an_erasure_rewrites_only_the_parts_that_held_it(
    client: Client, participant: Participant, in_parts: None
) -> None:
    sessions = [measure(participant) for _ in range(3)]
    export = exports.create_export()
    before = digests(export)

    participant.delete(f"/me/runs/{sessions[1]['runs'][0]['id']}")
    exports.rewrite_all()

    changed = {name for name, digest in digests(export).items() if before.get(name) != digest}
    of_runs = {name for name in changed if name.startswith("runs-")}
    assert of_runs == {"runs-5.parquet", "runs-5.csv.gz"}
    assert [len(rows(client, f"runs-{part}")) for part in range(4, 7)] == [1, 0, 1]


def test_a_part_whose_sessions_are_all_erased_stays_as_an_empty_one(
    client: Client, participant: Participant, join: Join, in_parts: None
) -> None:
    leaving = join()
    leaving.submit(submission_document())
    participant.submit(submission_document())
    exports.create_export()

    leaving.delete("/me")

    assert [len(rows(client, f"runs-{part}")) for part in range(1, 9)] == [0] * 4 + [1] * 4
    assert [len(rows(client, f"sessions-{part}")) for part in (1, 2)] == [0, 1]


def test_what_was_measured_later_is_not_in_a_rewritten_file(client: Client, participant: Participant) -> None:
    session = exported(participant)
    participant.submit(submission_document(session | {"runs": [run_document("best", 2, 4, 9_000)]}))
    participant.submit(submission_document())

    participant.delete(f"/me/runs/{session['runs'][0]['id']}")

    assert [row["run"] for row in rows(client, "runs")] == [run["id"] for run in session["runs"][1:]]
    assert [row["session"] for row in rows(client, "sessions")] == [session["id"]]


@IN_BOTH_PLACES
def test_a_download_that_has_begun_ends_with_the_old_file(client: Client, participant: Participant) -> None:
    session = exported(participant)
    whole = client.get(address("runs.parquet")).getvalue()
    begun = client.get(address("runs.parquet"))

    participant.delete(f"/me/runs/{session['runs'][0]['id']}")
    after = client.get(address("runs.parquet"))

    assert begun.getvalue() == whole
    new = after.getvalue()
    assert new != whole
    assert after.headers["ETag"] != begun.headers["ETag"]
    rest = client.get(
        address("runs.parquet"), headers={"Range": "bytes=100-", "If-Range": begun.headers["ETag"]}
    )
    again = client.get(address("runs.parquet"), headers={"If-None-Match": begun.headers["ETag"]})
    assert (rest.status_code, again.status_code) == (200, 200)
    assert rest.getvalue() == again.getvalue() == new


@IN_BOTH_PLACES
def test_stale_files_are_rewritten_before_anybody_asks(
    participant: Participant, django_capture_on_commit_callbacks: Any
) -> None:
    session = measure(participant)
    export = exports.create_export()
    before = digests(export)

    with django_capture_on_commit_callbacks(execute=True):
        participant.delete(f"/me/runs/{session['runs'][0]['id']}")

    assert not StoredFile.objects.filter(stale=True).exists()
    assert digests(export)["runs.parquet"] != before["runs.parquet"]
    assert all_files() == set(StoredFile.objects.values_list("stored_as", flat=True))


def test_erasing_run_after_run_sends_one_message(
    client: Client, participant: Participant, django_capture_on_commit_callbacks: Any
) -> None:
    """A worker rewrites for seconds: a message for each run would keep it from everything else."""
    session = exported(participant)
    sent: list[str] = []

    def note(sender: Any, **_: Any) -> None:
        sent.append(sender.name)

    task_prerun.connect(note)
    try:
        for run in session["runs"][:3]:
            with django_capture_on_commit_callbacks(execute=True):
                participant.delete(f"/me/runs/{run['id']}")
    finally:
        task_prerun.disconnect(note)

    assert sent.count("crowd.results.tasks.rewrite_exports") == 1
    # The others are rewritten for the reader.
    assert [row["run"] for row in rows(client, "runs")] == [session["runs"][3]["id"]]


@pytest.mark.slow
def test_a_reader_never_waits_for_another_rewriting(client: Client, participant: Participant) -> None:
    session = exported(participant)
    participant.delete(f"/me/runs/{session['runs'][0]['id']}")

    with locked_elsewhere():
        stale = client.get(address("runs.parquet"))
        other = client.get(address("configurations.parquet"))
        listed = client.get(f"{API}/exports").json()["results"][0]["files"]

    assert (stale.status_code, stale.json()["code"]) == (503, "export_in_preparation")
    assert int(stale.headers["Retry-After"]) > 0
    assert other.status_code == 200
    assert {file["name"]: file["stale"] for file in listed}["runs.parquet"] is True
    assert len(rows(client, "runs")) == 3


def test_an_erasure_while_a_part_is_rewritten_is_not_lost(
    client: Client, participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = exported(participant)
    first, second, *left = [run["id"] for run in session["runs"]]
    participant.delete(f"/me/runs/{first}")
    read, meanwhile = reading.READERS["runs"], [second]

    def erasing(scope: reading.Scope) -> Any:
        batches = list(read(scope))
        while meanwhile:
            participant.delete(f"/me/runs/{meanwhile.pop()}")
        return iter(batches)

    monkeypatch.setitem(reading.READERS, "runs", erasing)

    assert [row["run"] for row in rows(client, "runs")] == left


def test_an_export_that_reads_before_the_erasure_is_committed_is_marked(
    client: Client, participant: Participant, django_capture_on_commit_callbacks: Any, no_worker: None
) -> None:
    session = measure(participant)

    with django_capture_on_commit_callbacks(execute=True):
        participant.delete(f"/me/runs/{session['runs'][0]['id']}")
        # As another connection makes it, which does not see the erasure yet.
        exports.create_export()

    stale = set(StoredFile.objects.filter(stale=True).values_list("table", flat=True))
    assert stale == {table.name for table in TABLES} - {"configurations"} | set(DIGESTS)
    assert len(rows(client, "runs")) == 3


@IN_BOTH_PLACES
def test_what_an_interrupted_rewriting_left_behind_is_deleted(participant: Participant) -> None:
    participant.submit(submission_document())
    export = exports.create_export()
    half = storing.drafts() / "runs-0123456789abcdef.parquet"
    half.write_bytes(b"half of a file")
    storing.storage().take(half)
    (storing.drafts() / ".rewriting-abc").mkdir()
    whole = set(export.files.values_list("stored__stored_as", flat=True))

    exports.export_if_due()

    assert all_files() == whole


@IN_BOTH_PLACES
def test_a_file_that_cannot_be_rewritten_stops_no_other_one(client: Client, participant: Participant) -> None:
    participant.submit(submission_document())
    export = exports.create_export()
    delete(export, "sessions.parquet")
    marking.mark_erased([MeasurementSession.objects.get().pk])

    rewrite_exports()

    stale = set(StoredFile.objects.filter(stale=True).values_list("table", flat=True))
    assert stale == {"sessions", *DIGESTS}
    assert client.get(address("sessions.parquet")).status_code == 503
    assert client.get(address("runs.parquet")).status_code == 200


def test_the_lock_is_free_after_a_rewriting(db: None) -> None:
    for _ in range(2):
        with storing.exports_lock(0) as held:
            assert held
