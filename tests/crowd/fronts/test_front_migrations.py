"""Fronts and their log in a database of an earlier release, and back there."""

import json
from typing import Any

from django.core.management import call_command
from django.db import connection

from crowd.audit import guards as audit_guards
from crowd.audit.models import AuditEntry
from crowd.fronts.content import front_file
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import guards, services
from tests.crowd.documents import front_document
from tests.crowd.guarded import refused_by_the_database


def to(migration: str) -> None:
    """Undo the migrations of fronts after MIGRATION, and what needs them."""
    call_command("migrate", "fronts", migration, verbosity=0)


def selected(query: str) -> list[Any]:
    with connection.cursor() as cursor:
        cursor.execute(query)
        return cursor.fetchall()


def test_the_log_is_kept_by_earlier_releases(transactional_db: None, pack: dict[str, Any]) -> None:
    services.submit(services.create_draft(front_document(pack, version="1"), by="anna"), by="anna")
    services.publish_content(front_document(pack, version="2"))
    entries = list(AuditEntry.objects.values())

    to("0004")
    logged = selected("SELECT slug, action FROM fronts_auditentry ORDER BY id")
    to("0002")
    call_command("migrate", verbosity=0)

    assert logged[:2] == [("kfusion-1", "drafted"), ("kfusion-1", "submitted for review")]
    assert len(logged) == len(entries)
    assert list(AuditEntry.objects.values()) == entries
    refused_by_the_database(f"DELETE FROM {audit_guards.TABLE}")
    front = FrontVersion.objects.get(slug="kfusion-1")
    assert front.audit.first().action == "submitted for review"  # type: ignore[union-attr]


def test_fronts_of_the_first_release_are_kept_logged_and_guarded(
    transactional_db: None, pack: dict[str, Any]
) -> None:
    services.submit(services.create_draft(front_document(pack, version="1")))
    services.publish_content(front_document(pack, version="2"))

    to("0001")
    states = selected(f"SELECT slug, state FROM {guards.FRONT} ORDER BY slug")
    content = front_document(pack)
    with connection.cursor() as cursor:
        cursor.execute(
            f"INSERT INTO {guards.FRONT} (slug, application, version, state, digest, protocol, sequence, "
            "provenance, created_at, published_at) VALUES ('kfusion-test', 'kfusion', 'test', 'published', "
            "%s, %s, %s, %s, '2026-01-01 00:00:00', '2026-01-02 00:00:00')",
            [
                front_file.digest(content),
                *(json.dumps(value) for value in (content["protocol"], pack, content["provenance"])),
            ],
        )
    call_command("migrate", verbosity=0)

    # It knew no review.
    assert states == [("kfusion-1", "draft"), ("kfusion-2", "published")]
    rows = FrontVersion.objects.order_by("slug").values_list("slug", "state")
    assert list(rows) == [*states, ("kfusion-test", "published")]
    front = FrontVersion.objects.get(slug="kfusion-test")
    assert front.protocol == content["protocol"]
    entry = front.audit.get()
    assert (entry.actor, entry.action, entry.digest) == ("unknown", "published", front.digest)
    assert entry.at == front.published_at
    refused_by_the_database(f"UPDATE {guards.FRONT} SET digest = '0'")
