"""The files of runs are written once and shared by exports. Only small tables are written every night."""

import hashlib
from collections.abc import Iterator
from itertools import chain
from typing import Any

import pyarrow as pa
import pyarrow.parquet
import pytest
from django.test import Client

from crowd.results.models import Export, Run
from crowd.results.opendata import exports, part_writer, reading, run_parts
from crowd.results.opendata.reading import Block, Scope
from crowd.results.opendata.tables import RUNS
from tests.builders.crowds import Join
from tests.builders.documents import session_document, submission_document
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.crowd.buckets import IN_BOTH_PLACES
from tests.crowd.exported import aged_export, delete, stored


def parts(export: Export) -> list[list[str]]:
    """The ids of the runs in each part of `export`."""
    files = export.files.filter(stored__table="runs", stored__format="parquet").order_by("part")
    tables = [pyarrow.parquet.read_table(stored(export, file.name)) for file in files]
    return [table["run"].to_pylist() for table in tables]


def ids(session: dict[str, Any]) -> list[str]:
    return [run["id"] for run in session["runs"]]


def send(participant: Participant, pairs: int = 2) -> list[str]:
    """The ids of the runs of a new session, which has twice as many."""
    session = measure(participant, pairs=pairs)
    return ids(session)


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The ids of the runs that were read with their frames, as it grows."""
    seen: list[str] = []
    runs = reading.READERS["runs"]

    def noting(scope: Scope) -> Iterator[Block]:
        for block in runs(scope):
            seen.extend(block["run"])
            yield block

    monkeypatch.setitem(reading.READERS, "runs", noting)
    return seen


def test_an_export_of_the_same_runs_reads_and_writes_none(participant: Participant, read: list[str]) -> None:
    session = send(participant)
    first = exports.create_export()
    del read[:]

    second = exports.create_export()

    assert read == []
    assert parts(first) == parts(second) == [session]
    written = {file.stored for file in second.files.all()} - {file.stored for file in first.files.all()}
    # Each export gives installations other random names.
    assert {stored.table for stored in written} == {"sessions", "datapackage", "sums"}


def test_another_state_is_written_to_the_small_table(participant: Participant, read: list[str]) -> None:
    session = send(participant)
    first = exports.create_export()
    del read[:]
    Run.objects.filter(uuid=session[0]).update(state="quarantined", reason="decision")

    second = exports.create_export()

    assert read == []
    written = {file.stored for file in second.files.all()} - {file.stored for file in first.files.all()}
    assert {stored.table for stored in written} == {"run_states", "sessions", "datapackage", "sums"}
    states = pyarrow.parquet.read_table(stored(second, "run_states.parquet")).to_pylist()
    assert [(row["run"], row["state"]) for row in states][:2] == [
        (session[0], "quarantined"), (session[1], "valid"),
    ]  # fmt: skip


def test_new_runs_follow_in_a_part_of_their_own(participant: Participant, read: list[str]) -> None:
    old = [*send(participant), *send(participant)]
    first = exports.create_export()
    del read[:]
    new = send(participant)

    second = exports.create_export()

    assert read == new
    assert parts(second) == [old, new]
    assert parts(first) == [old]
    assert second.files.get(name="runs-1.parquet").stored == first.files.get(name="runs.parquet").stored


def test_small_parts_are_merged_with_as_many_newer_runs(
    participant: Participant, read: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[str] = []
    sizes = []
    for _ in range(5):
        runs += send(participant)
        export = exports.create_export()
        sizes.append([len(part) for part in parts(export)])

    assert sizes == [[4], [8], [8, 4], [16], [16, 4]]
    assert list(chain(*parts(export))) == runs
    monkeypatch.setattr(run_parts, "PART_BYTES", 1)
    runs += send(participant)
    assert list(chain(*parts(exports.create_export()))) == runs
    # Full parts stay.
    assert read[-4:] == runs[-4:]
    assert len(read) == 4 + 8 + 4 + 16 + 4 + 4


def test_a_run_that_was_committed_late_is_in_the_next_export(
    participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a lower key than one that an export had read: PostgreSQL gives keys before the commit."""
    early, late, last = send(participant), send(participant), send(participant)
    runs = reading.READERS["runs"]

    def uncommitted(scope: Scope) -> Iterator[Block]:
        for block in runs(scope):
            kept = [place for place, run in enumerate(block["run"]) if run not in late]
            yield {name: [values[place] for place in kept] for name, values in block.items()}

    with monkeypatch.context() as patched:
        patched.setitem(reading.READERS, "runs", uncommitted)
        assert parts(exports.create_export()) == [early + last]

    assert parts(exports.create_export()) == [early + late + last]


@IN_BOTH_PLACES
@pytest.mark.parametrize("missing", ["column", "runs.parquet", "runs.csv.gz"])
def test_a_part_without_a_column_or_its_file_is_written_again(
    participant: Participant, monkeypatch: pytest.MonkeyPatch, read: list[str], missing: str
) -> None:
    session = send(participant)
    first = exports.create_export()
    if missing == "column":
        columns = part_writer.schema(RUNS).append(pa.field("of_another_version", pa.int32()))
        monkeypatch.setattr(run_parts, "schema", lambda _: columns)
    else:
        delete(first, missing)

    second = exports.create_export()

    assert read == session * 2
    assert parts(second) == [session]


@IN_BOTH_PLACES
def test_who_is_erased_leaves_every_part_of_every_export(
    client: Client, participant: Participant, join: Join
) -> None:
    """Also the part with a run of an old session that arrived late."""
    leaving = join()
    session = session_document()
    early, late = session["runs"][:2], session["runs"][2:]
    leaving.submit(submission_document(session | {"runs": early}))
    staying = send(participant) + send(participant)
    release = aged_export()
    assert leaving.submit(submission_document(session | {"runs": late})).status_code == 202
    new = send(participant)
    newest = exports.create_export()
    assert parts(newest) == [ids(session)[:2] + staying, ids(session)[2:] + new]

    leaving.delete("/me")
    exports.rewrite_all()

    assert parts(newest) == [staying, new]
    assert parts(release) == [staying]
    for export in (release, newest):
        for file in export.files.all():
            content = client.get(f"/data/{export.name}/{file.name}").getvalue()
            assert hashlib.sha256(content).hexdigest() == file.stored.sha256
            assert file.name.endswith(("gz", "parquet")) or session["id"].encode() not in content


def test_a_part_that_is_rewritten_while_an_export_is_written_has_its_new_digest(
    client: Client, participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = send(participant)
    exports.create_export()
    devices, erased = reading.READERS["devices"], [session[0]]

    def erasing(scope: Scope) -> Any:
        while erased:
            participant.delete(f"/me/runs/{erased.pop()}")
            assert exports.rewrite_all()
        return devices(scope)

    monkeypatch.setitem(reading.READERS, "devices", erasing)

    exports.create_export()

    sums = client.get("/data/latest/SHA256SUMS").getvalue().decode().splitlines()
    for line in sums:
        digest, name = line.split("  ")
        assert hashlib.sha256(client.get(f"/data/latest/{name}").getvalue()).hexdigest() == digest


def test_an_export_whose_shared_parts_were_deleted_is_written_again(
    participant: Participant, monkeypatch: pytest.MonkeyPatch, read: list[str]
) -> None:
    session = send(participant)
    earlier = exports.create_export()
    del read[:]
    devices = reading.READERS["devices"]

    def removing(scope: Scope) -> Any:
        if Export.objects.filter(pk=earlier.pk).delete()[0]:
            exports.clean_up()
        return devices(scope)

    monkeypatch.setitem(reading.READERS, "devices", removing)

    export = exports.create_export()

    assert read == session
    assert parts(export) == [session]
