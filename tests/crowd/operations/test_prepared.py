"""Statements whose SQL is made once answer and store what query sets do."""

import uuid
from datetime import UTC, datetime
from typing import Any

import pytest
from django.db import IntegrityError, connection
from django.db.models import CharField, Q, UUIDField

from crowd.database.prepared import CompiledQuery, Placeholder, insert, insert_keyed
from crowd.devices.models import Installation
from crowd.explorations.models import ReferenceDevice
from crowd.results.models import WorkerPulse

COLUMNS = ("pk", "created_at", "revoked_at", "show_model", "app")


@pytest.fixture
def known(db: None) -> list[Installation]:
    return [
        Installation.objects.create(
            token_sha256=f"token-{name}", app=name, app_version="1", consent_version=1, show_model=shown
        )
        for name, shown in (("first", True), ("second", False))
    ]


def test_a_query_answers_as_its_query_set_whatever_comes_into_its_holes(known: list[Installation]) -> None:
    by_either = CompiledQuery(
        lambda: (
            Installation.objects.filter(
                Q(token_sha256=Placeholder("token", CharField())) | Q(pk=Placeholder("key", UUIDField())),
                revoked_at=None,
            )
            .order_by("app")
            .values_list(*COLUMNS)
        )
    )

    for token, key in (("token-first", known[1].pk), ("token-second", uuid.uuid4()), ("other", uuid.uuid4())):
        expected: Any = Installation.objects.filter(Q(token_sha256=token) | Q(pk=key)).order_by("app")
        assert by_either.rows(token=token, key=key) == list(expected.values_list(*COLUMNS))


def test_a_value_that_is_not_given_is_no_query(known: list[Installation]) -> None:
    query = CompiledQuery(
        lambda: Installation.objects.filter(app=Placeholder("app", CharField())).values_list("pk")
    )

    with pytest.raises(KeyError):
        query.rows()


def test_inserted_rows_are_as_they_were_made(db: None) -> None:
    moment = datetime(2026, 11, 22, 5, 30, tzinfo=UTC)

    insert([WorkerPulse(task=name, at=moment) for name in ("one", "two")])
    insert([])

    assert list(WorkerPulse.objects.order_by("task").values_list("task", "at")) == [
        ("one", moment),
        ("two", moment),
    ]


def test_a_row_gets_the_key_that_the_database_gave_it(db: None) -> None:
    rows = [ReferenceDevice(name=name, queue="bench", machines=2) for name in ("one", "two")]

    insert_keyed(rows)

    stored = ReferenceDevice.objects.order_by("name").values_list("pk", "name", "machines")
    assert list(stored) == [(row.pk, row.name, 2) for row in rows]


def test_a_duplicate_key_raises_an_error(db: None) -> None:
    with pytest.raises(IntegrityError):
        insert([WorkerPulse(task="one", at=datetime.now(UTC)) for _ in range(2)])


@pytest.mark.skipif(connection.vendor != "postgresql", reason="SQLite's driver keeps statements itself")
def test_the_database_plans_what_is_asked_often_once(known: list[Installation]) -> None:
    query = CompiledQuery(
        lambda: Installation.objects.filter(app=Placeholder("app", CharField())).values_list("pk")
    )

    asked = [query.rows(app=name) for name in ("first", "second", "other") * 3]

    assert asked == [[(known[0].pk,)], [(known[1].pk,)], []] * 3
    with connection.cursor() as cursor:
        cursor.execute("SELECT statement FROM pg_prepared_statements")
        statements = [statement for (statement,) in cursor.fetchall()]
    assert [each for each in statements if Installation._meta.db_table in each and "$1" in each], statements
