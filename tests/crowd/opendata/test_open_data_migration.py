"""Exports that an earlier version made stay available, and what is erased disappears from them."""

import io
import os
from typing import Any

import pyarrow.parquet
import pytest
from django.core.management import call_command
from django.db import connection
from django.db.migrations.executor import MigrationExecutor
from django.test import Client

from crowd.results.models import Export, Run
from crowd.results.opendata import exports
from tests.crowd.documents import session_document, submission_document
from tests.crowd.participant import API, Participant

BEFORE = [("results", "0006_summary_period")]


@pytest.fixture
def earlier(transactional_db: None, participant: Participant) -> dict[str, Any]:
    """A database with an export as the former version left it; what was sent before it."""
    session = session_document()
    participant.submit(submission_document(session))
    export = exports.create_export()
    folder = exports.exports_folder() / export.folder
    files = []
    for file in export.files.all():
        os.rename(folder / file.stored_as, folder / file.name)
        described = ("name", "table", "format", "rows", "bytes", "sha256")
        files.append({name: getattr(file, name) for name in described})
    package = {"name": "datapackage.json", "table": None, "format": "json", "rows": None, "bytes": 2}
    Export.objects.all().delete()
    executor = MigrationExecutor(connection)
    executor.migrate(BEFORE)
    former = MigrationExecutor(connection).loader.project_state(BEFORE).apps.get_model("results", "Export")
    former.objects.create(
        pk=export.pk,
        started_at=export.started_at,
        touched_at=export.started_at,
        published_at=export.published_at,
        files=[*files, package | {"sha256": "0" * 64}],
    )
    call_command("migrate", verbosity=0)
    return session


def test_an_export_of_an_earlier_version_is_served_and_forgets(
    client: Client, participant: Participant, earlier: dict[str, Any]
) -> None:
    def runs() -> list[str]:
        content = client.get("/data/latest/runs.parquet").getvalue()
        return list(pyarrow.parquet.read_table(io.BytesIO(content)).column("run").to_pylist())

    everything = [run["id"] for run in earlier["runs"]]
    assert runs() == everything
    export = Export.objects.get()
    assert export.last_run == Run.objects.latest("pk").pk
    names = [file["name"] for file in client.get(f"{API}/exports").json()["results"][0]["files"]]
    assert names.count("datapackage.json") == 1
    participant.submit(submission_document())

    participant.delete(f"/me/runs/{everything[0]}")

    assert runs() == everything[1:]
    content = client.get("/data/latest/sessions.parquet").getvalue()
    table = pyarrow.parquet.read_table(io.BytesIO(content))
    assert table.column("session").to_pylist() == [earlier["id"]]
