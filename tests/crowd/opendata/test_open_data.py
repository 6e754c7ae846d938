"""Exports: whole, described, free of who measured and of what was erased."""

import csv
import gzip
import hashlib
import io
import json
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from django.core.management import call_command
from django.db import connection
from django.test import Client
from django.test.utils import CaptureQueriesContext
from django.utils import timezone

from crowd.devices.models import DeviceModel, Installation
from crowd.results.models import Export, MeasurementSession, Run, StoredFile, Tombstone
from crowd.results.opendata import exports, reading, storing
from crowd.results.opendata.tables import TABLES
from tests.builders.crowds import Join, send
from tests.builders.documents import session_document, submission_document
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.crowd.buckets import IN_BOTH_PLACES
from tests.crowd.exported import all_files, lines, table


def test_an_export_holds_what_was_sent(participant: Participant) -> None:
    sent = session_document()
    sent["runs"][1] |= {"tracked": 97, "stages_us": None}
    participant.submit(submission_document(sent))

    exports.create_export()

    (session,) = table("sessions")
    assert session["session"] == sent["id"]
    assert (session["device"], session["front"]) == ("google-pixel-8", "kfusion-test")
    assert session["samples"] == sent["samples"]
    runs = table("runs")
    for stored, run in zip(runs, sent["runs"], strict=True):
        assert stored["run"] == run["id"]
        assert stored["frame_us"] == run["frame_us"]
        assert dict(stored["stages_us"]) == (run["stages_us"] or {})
        assert stored["tracked"] == (run["tracked"] if isinstance(run["tracked"], list) else [])
        assert stored["ate_max"] == run["ate_max"]
    assert runs[1]["tracked_frames"] == 97
    assert [row["run"] for row in table("run_states")] == [run["id"] for run in sent["runs"]]
    assert {(row["state"], row["mean_us"]) for row in table("run_states")} == {
        ("valid", 80_000.0), ("valid", 10_000.0),
    }  # fmt: skip
    (figure,) = table("figures")
    assert figure["speedup"] == pytest.approx(8.0)
    (summary,) = table("summaries")
    assert (summary["speedup"], summary["pairs"]) == (pytest.approx(8.0), 2)
    assert [row["configuration"] for row in table("configurations")] == ["default", "best", "accurate"]
    assert [row["sessions"] for row in table("devices")] == [1]


def test_csv_says_the_same_in_lines(participant: Participant) -> None:
    participant.submit(submission_document())

    exports.create_export()

    whole = {row["run"]: row for row in table("runs")}
    for line in lines("runs"):
        row = whole[line["run"]]
        assert float(line["ate_max"]) == row["ate_max"]
        assert line["configuration"] == row["configuration"]
        assert "frame_us" not in line
    assert len(whole) == len(lines("runs")) == 4
    means = [float(line["mean_us"]) for line in lines("run_states")]
    assert means == [row["mean_us"] for row in table("run_states")]


def test_a_spreadsheet_sees_no_formula(participant: Participant) -> None:
    participant.submit(submission_document())
    # As an imported catalogue may say.
    DeviceModel.objects.update(manufacturer="", market_name='=HYPERLINK("x")')

    exports.create_export()

    assert lines("devices")[0]["name"] == '\'=HYPERLINK("x") (Pixel 8)'
    assert table("devices")[0]["name"] == '=HYPERLINK("x") (Pixel 8)'


@IN_BOTH_PLACES
def test_the_description_has_every_column_and_digest(client: Client, participant: Participant) -> None:
    participant.submit(submission_document())

    exports.create_export()

    def served(name: str) -> bytes:
        return bytes(client.get(f"/data/latest/{name}").getvalue())

    package = json.loads(served("datapackage.json"))
    assert package["licenses"][0]["name"] == "CC-BY-4.0"
    for resource in package["resources"]:
        content = served(resource["path"])
        assert resource["hash"] == f"sha256:{hashlib.sha256(content).hexdigest()}"
        assert resource.get("bytes") == (None if resource["format"] == "parquet" else len(content))
        described = [field["name"] for field in resource["schema"]["fields"]]
        if resource["format"] == "parquet":
            assert pyarrow.parquet.read_schema(io.BytesIO(content)).names == described
        else:
            first, *_ = gzip.decompress(content).decode().splitlines()
            assert next(csv.reader([first])) == described
        assert all(field["description"] for field in resource["schema"]["fields"])
        assert set(resource["schema"]["primaryKey"]) <= set(described)
        for key in resource["schema"]["foreignKeys"]:
            [other] = [row for row in package["resources"] if row["name"] == key["reference"]["resource"]]
            assert set(key["fields"]) <= set(described)
            assert key["reference"]["fields"] == other["schema"]["primaryKey"]
        for field in resource["schema"]["fields"]:
            assert not field["name"].endswith(("low", "high")) or field["unit"] == "ratio"
    assert len(package["resources"]) == 2 * len(TABLES)
    sums = served("SHA256SUMS").decode().splitlines()
    assert len(sums) == 2 * len(TABLES) + 3
    for line in sums:
        digest, name = line.split("  ")
        assert hashlib.sha256(served(name)).hexdigest() == digest


def test_nothing_in_an_export_says_who_measured(participant: Participant, join: Join) -> None:
    other = join()
    for each in (participant, participant, other):
        each.submit(submission_document(session_document(started_at="2026-11-20T10:17:31Z")))

    exports.create_export()
    first = [row["installation"] for row in table("sessions")]
    times = {row["started_at"].isoformat() for row in table("sessions")}
    exports.create_export()
    second = [row["installation"] for row in table("sessions")]

    assert first[0] == first[1] != first[2]
    assert second[0] == second[1] != second[2]
    assert not set(first) & set(second)
    assert times == {"2026-11-20T10:00:00+00:00"}
    secrets = [participant.installation_id, participant.installation_id.replace("-", ""), participant.token]
    for name in all_files():
        content = storing.storage().open(name).read()
        content = gzip.decompress(content) if name.endswith(".gz") else content
        assert not any(secret.encode() in content for secret in secrets), name


def test_a_large_table_is_read_in_blocks(participant: Participant, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(3):
        participant.submit(submission_document())
    monkeypatch.setattr(reading, "BLOCK_ROWS", 5)

    with CaptureQueriesContext(connection) as queries:
        blocks = list(reading.runs(reading.Scope.now()))

    assert [len(block["run"]) for block in blocks] == [5, 5, 2]
    # No session is divided.
    assert [len(block["run"]) for block in reading.run_states(reading.Scope.now())] == [4, 4, 4]
    of_runs = [query["sql"] for query in queries if "results_run" in query["sql"]]
    assert all("LIMIT" in statement for statement in of_runs)
    exports.create_export()
    assert [row["run"] for row in table("runs")] == [str(run.uuid) for run in Run.objects.order_by("pk")]


def test_a_block_of_runs_is_bounded_in_bytes(
    participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    """100 frames, with four stages and tracking, take 2,100 bytes; without stages 500."""
    large, *small = (session_document() for _ in range(4))
    for session in small:
        session["runs"] = [run | {"stages_us": {}} for run in session["runs"]]
    for session in (large, *small):
        send(participant, session)
    monkeypatch.setattr(reading, "BLOCK_BYTES", 4_200)

    blocks = list(reading.runs(reading.Scope.now()))

    # The large session takes two blocks, and two small ones fit into one.
    assert [[str(key) for key in dict.fromkeys(block["session"])] for block in blocks] == [
        [large["id"]], [large["id"]], [small[0]["id"], small[1]["id"]], [small[2]["id"]],
    ]  # fmt: skip


@pytest.mark.slow
def test_a_block_of_sessions_is_bounded_in_bytes(
    participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = [{"t": float(second), "temperature_c": 40.0} for second in range(50)]
    for count in (1, 1, 50, 50, 1):
        measure(participant, samples=samples[:count])
    longest = max(len(json.dumps(row.samples)) for row in MeasurementSession.objects.all())
    monkeypatch.setattr(reading, "BLOCK_BYTES", longest + 40)

    blocks = list(reading.sessions(reading.Scope.now()))

    assert [len(block["session"]) for block in blocks] == [2, 1, 2]
    exports.create_export()
    assert [len(row["samples"]) for row in table("sessions")] == [1, 1, 50, 50, 1]


def test_an_empty_server_exports_its_columns(db: None) -> None:
    exports.create_export()

    assert table("runs") == []
    assert lines("sessions") == []


def test_erasing_everything_leaves_tombstones_without_a_name(participant: Participant) -> None:
    session = measure(participant)

    participant.delete("/me")
    exports.create_export()

    kinds = [row["kind"] for row in table("tombstones")]
    assert sorted(kinds) == ["installation", "run", "run", "run", "run", "session"]
    kept = str([vars(stone) for stone in Tombstone.objects.all()])
    assert not any(name in kept for name in (participant.installation_id, session["id"], "Pixel"))
    assert table("runs") == table("sessions") == table("figures") == []


@IN_BOTH_PLACES
def test_what_is_erased_while_an_export_is_written_is_not_in_it(
    participant: Participant, join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    participant.submit(submission_document())
    join().submit(submission_document())
    read = reading.READERS["devices"]

    def erasing(scope: reading.Scope) -> Any:
        if Installation.objects.filter(pk=participant.installation_id).exists():
            participant.delete("/me")
        return read(scope)

    monkeypatch.setitem(reading.READERS, "devices", erasing)

    exports.create_export()

    assert len(table("sessions")) == 1
    assert len(table("runs")) == 4
    assert [row["installations"] for row in table("devices")] == [1]
    export = Export.objects.get()
    assert export.changed_while_written
    assert not StoredFile.objects.filter(stale=True).exists()
    stored = set(StoredFile.objects.values_list("stored_as", flat=True))
    assert all_files() == stored


def test_an_export_that_was_taken_for_dead_is_made_again(
    participant: Participant, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when its machine slept for longer than the sweep of another process waits."""
    participant.submit(submission_document())
    read, attempts = reading.READERS["devices"], []

    def swept(scope: reading.Scope) -> Any:
        attempts.append(scope)
        if len(attempts) == 1:
            Export.objects.update(touched_at=timezone.now() - exports.ABANDONED_AFTER * 2)
            exports.clean_up()
        return read(scope)

    monkeypatch.setitem(reading.READERS, "devices", swept)

    export = exports.create_export()

    assert len(attempts) == 2
    assert Export.objects.get() == export
    assert len(table("sessions")) == 1


@IN_BOTH_PLACES
def test_an_export_that_fails_leaves_nothing(db: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(scope: reading.Scope) -> Any:
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(reading.READERS, "tombstones", full)

    with pytest.raises(OSError, match="No space"):
        exports.create_export()

    assert all_files() == set()
    assert not Export.objects.exists()


def test_the_command_says_what_it_wrote(participant: Participant, capsys: pytest.CaptureFixture[str]) -> None:
    participant.submit(submission_document())

    call_command("results", "export")

    assert "runs.parquet: 4 rows" in capsys.readouterr().out


def test_series_of_unequal_length_stay_apart_and_those_of_a_failed_run_may_be_empty(
    participant: Participant,
) -> None:
    session = session_document()
    session["runs"][1] |= {"status": "failed", "frame_us": [7, 8, 9], "stages_us": {"tracking": [1, 2, 3]},
                           "tracked": [True, False, None]}  # fmt: skip
    session["runs"][3] |= {
        "status": "failed", "failure": "out of memory", "frame_us": [], "stages_us": {}, "tracked": [],
        "ate_max": None,
    }  # fmt: skip
    send(participant, session)

    exports.create_export()

    first, second, _, failed = table("runs")
    assert (failed["status"], failed["frame_us"]) == ("failed", [])
    assert table("run_states")[3]["mean_us"] is None
    assert np.sum(first["frame_us"]) == 80_000 * 100
    assert second["frame_us"] == [7, 8, 9]
    assert second["stages_us"] == [("tracking", [1, 2, 3])]
    assert second["tracked"] == [True, False, None]


def test_a_model_that_ceases_to_be_public_is_not_named_in_files(
    client: Client, participant: Participant, settings: Any, django_capture_on_commit_callbacks: Any
) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    participant.submit(submission_document(show_model=True))
    naming = exports.create_export()
    assert [row["name"] for row in table("devices")] == ["Pixel 8"]

    with django_capture_on_commit_callbacks(execute=True):
        participant.submit(submission_document(show_model=False))

    for name in ("devices", "sessions", "figures"):
        content = client.get(f"/data/{naming.name}/{name}.parquet").getvalue()
        rows = pyarrow.parquet.read_table(io.BytesIO(content)).to_pylist()
        assert len(rows) == 1
        assert "pixel" not in str(rows).casefold()
