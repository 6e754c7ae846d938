"""One number for everything that pages show of devices and figures: it changes with every change of either.

A writer adds a row in the transaction of its change and waits for no other writer; a reader asks for the
newest row and for the number of rows, since a transaction with an earlier number may commit later.
"""

from django.db.models import Count, Max

from crowd.devices.models import Revision

KEPT = 100


def bump() -> None:
    """Note a change; call it in the transaction that makes the change."""
    Revision.objects.create()


def current() -> str:
    """Another text after every committed change, the same in every process. One query over a few rows."""
    found = Revision.objects.aggregate(last=Max("pk"), rows=Count("pk"))
    return f"{found['last'] or 0}-{found['rows']}"


def prune() -> None:
    """Delete all but the newest KEPT rows."""
    last = Revision.objects.order_by("-pk").values_list("pk", flat=True)[KEPT - 1 : KEPT]
    for key in last:
        Revision.objects.filter(pk__lt=key).delete()
