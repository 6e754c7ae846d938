"""Multiplies the measurements of a PostgreSQL database by SQL, to sizes that no client could send.

Each copy has installations, submissions, sessions, runs and summaries of its own, with other keys, ids,
networks, fingerprints and days. Its series of frame times are those of the original: a run of a copy must not
be judged again, as it would be an identical series. Secondary indexes are built after the data.
"""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg

# With indexes, write-ahead log, and the files that sort an index.
BYTES_A_RUN = 2_500
MOST_BYTES = 35_000_000_000
RESERVED_BYTES = 15_000_000_000  # for the other programs on the disk
MEMORY = "512MB"  # to sort an index

INSTALLATION = "md5(installation_id || '/' || n)::uuid"
# By table: the columns of copy `n` that differ from those of its original.
DIFFERENT: dict[str, dict[str, str]] = {
    "devices_installation": {
        "id": "md5(id || '/' || n)::uuid",
        "token_sha256": "md5(token_sha256 || '/' || n)",
        "network": "md5(network || '/' || n)",
    },
    "results_submission": {
        "id": "md5(id || '/' || n)::uuid",
        "installation_id": INSTALLATION,
        "idempotency_key": "md5(idempotency_key || '/' || n)",
        "received_at": "received_at - n * interval '1 day'",
    },
    "results_measurementsession": {
        "id": "id + n * {sessions}",
        "uuid": "gen_random_uuid()",
        "installation_id": INSTALLATION,
        "submission_id": "md5(submission_id || '/' || n)::uuid",
        "received_at": "received_at - n * interval '1 day'",
        "started_at": "started_at - n * interval '1 day'",
    },
    "results_run": {
        "id": "id + n * {runs}",
        "uuid": "gen_random_uuid()",
        "session_id": "session_id + n * {sessions}",
        "fingerprint": "hashint8extended(fingerprint, n)",
    },
    "results_runframes": {"run_id": "run_id + n * {runs}"},
    "results_sessionsummary": {
        "id": "id + n * {summaries}",
        "session_id": "session_id + n * {sessions}",
        "installation_id": INSTALLATION,
        "started_at": "started_at - n * interval '1 day'",
        "day": "day - n",
    },
}
KEYED = {
    "sessions": "results_measurementsession",
    "runs": "results_run",
    "summaries": "results_sessionsummary",
}
INDEXES = """
SELECT indexdef, format('DROP INDEX %%I', indexname) FROM pg_indexes JOIN pg_class ON relname = indexname
WHERE tablename = ANY(%(tables)s) AND NOT EXISTS (SELECT FROM pg_constraint WHERE conindid = pg_class.oid)
UNION ALL
SELECT
    format('ALTER TABLE %%s ADD CONSTRAINT %%I ', conrelid::regclass, conname) || pg_get_constraintdef(oid),
    format('ALTER TABLE %%s DROP CONSTRAINT %%I', conrelid::regclass, conname)
FROM pg_constraint WHERE conrelid::regclass::text = ANY(%(tables)s) AND contype = 'u'
"""


def affordable(runs: int, folder: Path) -> tuple[int, str]:
    """How many of `runs` fit on the disk of `folder`, and why not all; empty if they do."""
    free = shutil.disk_usage(folder).free
    room = min(MOST_BYTES, free - RESERVED_BYTES)
    if runs * BYTES_A_RUN <= room:
        return runs, ""
    fitting = max(room, 0) // BYTES_A_RUN
    return fitting, (
        f"{fitting} of {runs} runs: a run takes {BYTES_A_RUN} bytes while it is filled, the disk of {folder} "
        f"has {free / 1e9:.0f} GB free, {RESERVED_BYTES / 1e9:.0f} of them reserved, and "
        f"{MOST_BYTES / 1e9:.0f} are used at most"
    )


def multiply(url: str, copies: int) -> dict[str, float]:
    """Add `copies` copies of all measurements, and have all figures computed again; the seconds of each step.

    Only for sessions that are summarised. Triggers, and with them foreign keys, are not checked.
    """
    with psycopg.connect(url, autocommit=True) as database:
        database.execute("SET session_replication_role = replica")
        database.execute("SET synchronous_commit = off")
        database.execute(f"SET maintenance_work_mem = '{MEMORY}'")
        begun = time.perf_counter()
        with _without_indexes(database):
            _insert(database, copies)
            filled = time.perf_counter()
        for table in KEYED.values():
            database.execute(f"SELECT setval(pg_get_serial_sequence('{table}', 'id'), max(id)) FROM {table}")
        indexed = time.perf_counter()
        database.execute("UPDATE results_cohort SET stale = true")
        # Else autovacuum does so while something is measured.
        database.execute("VACUUM ANALYZE")
        vacuumed = time.perf_counter()
    return {
        "rows_s": round(filled - begun, 1),
        "indexes_s": round(indexed - filled, 1),
        "vacuum_s": round(vacuumed - indexed, 1),
    }


def _insert(database: psycopg.Connection, copies: int) -> None:
    largest = {
        name: database.execute(f"SELECT max(id) FROM {table}").fetchone()[0] for name, table in KEYED.items()
    }
    statements = []
    for table, different in DIFFERENT.items():
        database.execute(f"CREATE TEMPORARY TABLE original_{table} AS TABLE {table}")
        columns = [column.name for column in database.execute(f"TABLE {table} LIMIT 0").description]
        names = ", ".join(f'"{name}"' for name in columns)
        values = ", ".join(different.get(name, f'"{name}"').format(**largest) for name in columns)
        statements.append(
            f"INSERT INTO {table} ({names}) SELECT {values} FROM original_{table}, (SELECT %s::int AS n) _"
        )
    for copy in range(1, copies + 1):
        for statement in statements:
            database.execute(statement, [copy])


@contextmanager
def _without_indexes(database: psycopg.Connection) -> Iterator[None]:
    """Drop all indexes but those of primary keys, and build them again at the end."""
    indexes = database.execute(INDEXES, {"tables": list(DIFFERENT)}).fetchall()
    for _, drop in indexes:
        database.execute(drop)
    yield
    for create, _ in indexes:
        database.execute(create)
