"""A revision of devices and figures: a cache key that changes whenever pages have to change.

A writer adds a row in the transaction of its change, without waiting for other writers. A reader combines the
newest row with the number of rows, because a transaction with an earlier row may commit later.
"""

from django.db import connection

from crowd.devices.models import Revision

KEPT_ROWS = 100
# Asked by every page, often several times. Django takes longer to write this SQL than a database to run it.
CURRENT = f"SELECT MAX(id), COUNT(id) FROM {Revision._meta.db_table}"


def bump() -> None:
    """Record a change. Call it in the transaction that makes the change."""
    Revision.objects.create()


def current() -> str:
    """The current revision, the same in every process. One query over a few rows."""
    with connection.cursor() as cursor:
        cursor.execute(CURRENT)
        last, rows = cursor.fetchone()
    return f"{last or 0}-{rows}"


def prune() -> None:
    """Delete all but the newest KEPT_ROWS rows."""
    last = Revision.objects.order_by("-pk").values_list("pk", flat=True)[KEPT_ROWS - 1 : KEPT_ROWS]
    for key in last:
        Revision.objects.filter(pk__lt=key).delete()
