"""A revision of devices and figures: a cache key that changes whenever pages have to change.

A writer adds a row in the transaction of its change, without waiting for other writers. A reader combines the
newest row with the number of rows, because a transaction with an earlier row may commit later.
"""

from django.db.models import Count, Max

from crowd.devices.models import Revision

KEPT_ROWS = 100


def bump() -> None:
    """Record a change. Call it in the transaction that makes the change."""
    Revision.objects.create()


def current() -> str:
    """The current revision, the same in every process. One query over a few rows."""
    stored = Revision.objects.aggregate(last=Max("pk"), rows=Count("pk"))
    return f"{stored['last'] or 0}-{stored['rows']}"


def prune() -> None:
    """Delete all but the newest KEPT_ROWS rows."""
    last = Revision.objects.order_by("-pk").values_list("pk", flat=True)[KEPT_ROWS - 1 : KEPT_ROWS]
    for key in last:
        Revision.objects.filter(pk__lt=key).delete()
