"""Checks of the running service: workers, backups, disk, database, data, clocks."""

import secrets
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path

from django.conf import settings
from django.db import connection
from django.utils import timezone

from crowd.fronts import intake_policy, selectors
from crowd.operations import broker, health
from crowd.operations.backup import TASK as BACKUP_TASK
from crowd.operations.public.check_result import CheckResult, passed, to_do, unknown
from crowd.results.models import Export, MeasurementSession, WorkerPulse
from crowd.results.opendata.storing import storage

# The beat asks the worker for the sweep every half minute.
SWEEP, SWEEP_AGE = "sweep", timedelta(minutes=3)
BACKUP_AGE = EXPORT_AGE = timedelta(hours=50)  # they run every night, and one may fail
LEAST_FREE_BYTES = 2 << 30
# A backup needs room for the database twice, and the database grows.
LEAST_FREE_DATABASES = 4
MOST_CLOCK_SECONDS = 2.0
CLOCK_TIMEOUT_SECONDS = 5


def run() -> Iterator[CheckResult]:
    """Check the running service."""
    yield from health_now()
    yield _open_data()
    if "sequences" in settings.STORAGES:
        yield _bucket()
    yield _clocks()
    yield _monitoring()


def health_now() -> Iterator[CheckResult]:
    """The checks that the administration's first page shows."""
    yield _fronts()
    yield _intake()
    yield _database()
    yield _broker()
    yield _worker()
    yield _backup()
    yield _disk()


def _database() -> CheckResult:
    if connection.vendor == "sqlite":
        advice = "for a large crowd, or several machines, set DATABASE_URL to a PostgreSQL"
        return passed("Database", "SQLite, for one machine", advice)
    return passed("Database", f"{connection.vendor} answers")


def _broker() -> CheckResult:
    state = broker.state()
    if state != "ok":
        return to_do("Broker", state, "look after the broker that CELERY_BROKER_URL names")
    return passed("Broker", "answers")


def _worker() -> CheckResult:
    title, remedy = "Worker and beat", "start both: frontrunner serve, or deploy/frontrunner-worker and -beat"
    age = _age_of(SWEEP)
    if age is None:
        return to_do(title, "no periodic task has run yet", remedy)
    if age > SWEEP_AGE:
        return to_do(title, f"the last periodic task ran {_duration(age)} ago", remedy)
    return passed(title, f"a periodic task ran {_duration(age)} ago")


def _backup() -> CheckResult:
    title, age = "Backup", _age_of(BACKUP_TASK)
    remedy = "systemctl start frontrunner-backup, or: frontrunner admin backup FILE; try a restore once"
    if age is None and connection.vendor != "sqlite":
        return unknown(
            title, "frontrunner admin backup has not run; backups by other tools cannot be seen", remedy
        )
    if age is None:
        return to_do(title, "there is no backup yet", remedy)
    if age > BACKUP_AGE:
        return to_do(title, f"the last backup was made {_duration(age)} ago", remedy)
    return passed(title, f"made {_duration(age)} ago", "keep it on another machine, and try a restore once")


def _disk() -> CheckResult:
    free, stored = shutil.disk_usage(settings.FRONTRUNNER_VAR).free, health.database_bytes()
    finding = f"{free / 1e9:.1f} GB free, the database has {stored / 1e9:.2f} GB"
    least = max(LEAST_FREE_BYTES, LEAST_FREE_DATABASES * stored)
    if free < least:
        return to_do("Disk", finding, f"make room for {least / 1e9:.1f} GB at {settings.FRONTRUNNER_VAR}")
    return passed("Disk", finding)


def _fronts() -> CheckResult:
    measured = selectors.measured_now()
    if not measured:
        remedy = "publish a front: frontrunner admin front publish FILE, or the administration"
        return to_do("Fronts", "no front is published: clients have nothing to measure", remedy)
    return passed("Fronts", f"clients measure {', '.join(measured.values())}")


def _intake() -> CheckResult:
    if intake_policy.current().accepting:
        return passed("Intake", "measurements are accepted")
    remedy = "open it under Intake policy"
    return to_do("Intake", "measurements are not accepted", remedy)


def _open_data() -> CheckResult:
    title = "Open data"
    newest = Export.objects.filter(published_at__isnull=False, removed_at=None).first()
    remedy = "the worker writes them every night; frontrunner admin results export writes them now"
    if newest is None or newest.published_at is None:
        return to_do(title, "no file has been written yet", remedy)
    age = timezone.now() - newest.published_at
    if age > EXPORT_AGE:
        return to_do(title, f"the newest files were written {_duration(age)} ago", remedy)
    return passed(title, f"written {_duration(age)} ago (/data/)")


def _bucket() -> CheckResult:
    """Writes, reads and deletes a small file, with the rights that an erasure needs."""
    title = "Bucket"
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"check-{secrets.token_hex(8)}"
            file.write_bytes(b"a file of check_public")
            storage().take(file)
        with storage().open(file.name) as stored:
            stored.read()
        storage().delete(file.name)
    except OSError as error:
        return to_do(title, str(error), "give the account the rights that docs/operate/deploy.md lists")
    return passed(title, "a file was written, read and deleted with its versions")


def _clocks() -> CheckResult:
    title, remedy = "Clocks", "let this machine follow a time server (systemd-timesyncd, chrony)"
    newest = MeasurementSession.objects.order_by("-pk").values_list("received_at", flat=True).first()
    behind = (newest - timezone.now()).total_seconds() if newest else 0.0
    if behind > MOST_CLOCK_SECONDS:
        return to_do(title, f"this machine's clock is {behind:.0f} s behind stored times", remedy)
    ahead = _seconds_ahead_of_database()
    if abs(ahead) > MOST_CLOCK_SECONDS:
        side = "ahead of" if ahead > 0 else "behind"
        return to_do(title, f"this machine's clock is {abs(ahead):.0f} s {side} the database's", remedy)
    followed = _follows_a_time_server()
    if followed is None:
        return unknown(title, "this machine does not tell whether it follows a time server", remedy)
    if not followed:
        return to_do(title, "this machine does not follow a time server", remedy)
    return passed(title, "this machine follows a time server")


def _monitoring() -> CheckResult:
    title = "Monitoring"
    remedy = "the server sends no mail: let a monitor read /readyz and /metrics (FRONTRUNNER_WATCHERS)"
    if settings.FRONTRUNNER_WATCHERS:
        networks = ", ".join(map(str, settings.FRONTRUNNER_WATCHERS))
        return passed(title, f"{networks} may read /metrics", "the server itself sends no mail")
    return unknown(title, "a monitor on this machine cannot be detected", remedy)


def _age_of(task: str) -> timedelta | None:
    last = WorkerPulse.objects.filter(task=task).values_list("at", flat=True).first()
    return None if last is None else max(timezone.now() - last, timedelta())


def _seconds_ahead_of_database() -> float:
    """Seconds by which this clock is ahead of the database's. SQLite uses the same clock."""
    if connection.vendor != "postgresql":
        return 0.0
    with connection.cursor() as cursor:
        cursor.execute("SELECT clock_timestamp()")
        there: datetime = cursor.fetchone()[0]
    return (timezone.now() - there).total_seconds()


def _follows_a_time_server() -> bool | None:
    """Whether systemd reports a synchronised clock; None if it reports nothing."""
    command = ["timedatectl", "show", "--property=NTPSynchronized", "--value"]
    try:
        reported = subprocess.run(
            command, capture_output=True, text=True, timeout=CLOCK_TIMEOUT_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return {"yes": True, "no": False}.get(reported.stdout.strip()) if reported.returncode == 0 else None


def _duration(age: timedelta) -> str:
    seconds = age.total_seconds()
    for size, name in ((86_400, "days"), (3_600, "hours"), (60, "minutes")):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {name}"
    return f"{seconds:.0f} seconds"
