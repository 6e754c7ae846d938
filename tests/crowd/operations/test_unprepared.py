"""A web server that `frontrunner admin prepare` did not prepare says so: 503 and the remedy, never 500."""

from typing import Any

import pytest
from django.db import connection
from django.db.migrations.recorder import MigrationRecorder
from django.test import Client

from tests.builders.participant import API

MISSING_TABLES = "tables of this version are missing in the database: run frontrunner admin prepare"
MANIFEST = {"staticfiles": {"BACKEND": "whitenoise.storage.CompressedManifestStaticFilesStorage"}}


@pytest.fixture
def visitor() -> Client:
    """Gets the answers to failures that the server would send."""
    return Client(raise_request_exception=False)


@pytest.fixture
def without_tables(transactional_db: None) -> Any:
    """The database lacks the newest tables, as before `prepare`."""
    applied = MigrationRecorder.Migration.objects.filter(app="results")
    rows = list(applied)
    applied.delete()
    with connection.cursor() as cursor:
        cursor.execute("ALTER TABLE results_export RENAME TO results_export_away")
    yield
    with connection.cursor() as cursor:
        cursor.execute("ALTER TABLE results_export_away RENAME TO results_export")
    MigrationRecorder.Migration.objects.bulk_create(rows)


@pytest.mark.parametrize("path", ["/data/", f"{API}/exports"])
def test_without_tables_pages_and_api_say_so(visitor: Client, without_tables: None, path: str) -> None:
    ready, answer = visitor.get("/readyz"), visitor.get(path)

    assert (ready.status_code, ready.json()["prepared"]) == (503, MISSING_TABLES)
    assert ready.json()["database"] == "ok"
    assert (answer.status_code, answer.json()["code"]) == (503, "server_not_prepared")
    assert answer.json()["detail"] == MISSING_TABLES
    assert int(answer.headers["Retry-After"]) > 0


def test_without_static_files_pages_say_so(visitor: Client, db: None, settings: Any) -> None:
    settings.STORAGES = settings.STORAGES | MANIFEST

    ready, page = visitor.get("/readyz"), visitor.get("/data/")

    assert ready.status_code == 503
    assert "this machine has no static files" in ready.json()["prepared"]
    assert (page.status_code, page.json()["code"]) == (503, "server_not_prepared")


def test_another_failure_of_a_prepared_server_stays_one(
    visitor: Client, db: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: Any) -> None:
        raise ValueError("a bug")

    monkeypatch.setattr("crowd.results.opendata.views.listed_exports", failing)

    answer = visitor.get(f"{API}/exports")

    assert visitor.get("/readyz").status_code == 200
    assert (answer.status_code, answer.json()["code"]) == (500, "internal_error")
