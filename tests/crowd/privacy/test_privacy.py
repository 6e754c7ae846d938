"""What is kept of a participant, looked for in every table, every file and every line of the log."""

import logging
from pathlib import Path

import pytest
from django.apps import apps
from django.db import connection, models
from django.test import Client

from crowd.audit.models import AuditEntry
from crowd.results.intake.checks import PERSONAL_WORDS
from crowd.results.opendata import exports
from tests.builders.documents import device_document, submission_document
from tests.builders.measuring import measure
from tests.builders.participant import API, Participant

ADDRESS, HOST, NAME, PROGRAM = (
    "203.0.113.77",
    "alices-laptop.example",
    "alice-the-participant",
    "AlicesBrowser/9",
)
WHO = {
    "REMOTE_ADDR": ADDRESS,
    "REMOTE_HOST": HOST,
    "REMOTE_USER": NAME,
    "HTTP_X_FORWARDED_FOR": ADDRESS,
    "HTTP_USER_AGENT": PROGRAM,
    "HTTP_FROM": f"{NAME}@{HOST}",
    "HTTP_REFERER": f"https://{HOST}/",
}


def stored() -> str:
    """Every row of every table of the database, as text."""
    rows = []
    with connection.cursor() as cursor:
        for name in connection.introspection.table_names(cursor):
            cursor.execute(f"SELECT * FROM {connection.ops.quote_name(name)}")
            rows += [str(row) for row in cursor.fetchall()]
    return "\n".join(rows)


def test_nothing_tells_who_measured_or_from_where(
    participant: Participant, own_data_folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    client = Client(**WHO)
    enrolled = client.post(
        f"{API}/enrol",
        {"app": "client_kit", "app_version": "0.1.0", "consent_version": 2},
        content_type="application/json",
    ).json()
    visitor = Participant(client, enrolled["token"], enrolled["installation_id"])
    session = measure(visitor)
    assert visitor.submit(b"no JSON").status_code == 400
    refused = visitor.submit(submission_document(device=device_document(hostname=HOST, username=NAME)))
    assert refused.json()["code"] == "personal_data"
    for path in ("/", "/devices/", f"/runs/{session['runs'][0]['id']}/", f"{API}/speedups", "/nothing/"):
        client.get(path)
    client.post("/admin/login/", {"username": NAME, "password": "wrong"})
    visitor.own_data()
    visitor.delete(f"/me/runs/{session['runs'][0]['id']}")
    exports.create_export()

    database, log = stored(), caplog.text
    files = {path: path.read_bytes() for path in own_data_folder.rglob("*") if path.is_file()}
    assert "Mali-G715" in database
    assert len(files) > 5
    for secret in (ADDRESS, HOST, NAME, PROGRAM, visitor.token):
        assert secret not in database
        assert secret not in log
        assert [path for path, content in files.items() if secret.encode() in content] == []


def test_no_table_has_a_place_for_it() -> None:
    for model in apps.get_models():
        if not model.__module__.startswith("crowd."):
            continue
        for field in model._meta.concrete_fields:
            assert not isinstance(field, models.GenericIPAddressField), field
            # That of a run's times, and the key of a member of the staff.
            if field.name != "fingerprint" and field != AuditEntry._meta.get_field("account"):
                assert not set(field.name.split("_")) & PERSONAL_WORDS, field
