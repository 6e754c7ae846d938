"""Monitoring: whether the server runs, whether it can work, how much it has stored, what waits.

`/healthz` is public. `/readyz` and `/metrics` answer direct requests from this machine and requests from the
networks in FRONTRUNNER_WATCHERS. All others get 404.
"""

import shutil
from collections.abc import Callable, Iterator
from datetime import datetime
from functools import wraps
from pathlib import Path

from django.conf import settings
from django.db import Error, connection
from django.db.models import Min
from django.http import Http404, HttpRequest, HttpResponse, JsonResponse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from crowd.access.addresses import is_this_machine, is_within
from crowd.explorations.measuring.software import software_version
from crowd.explorations.models import Evaluation
from crowd.fronts.content import plans
from crowd.http.preparation import find_unprepared
from crowd.observability import metrics as exposition
from crowd.observability import processes
from crowd.observability.metrics import gauge, label
from crowd.operations import broker, row_counts
from crowd.results.figures import sessions as session_figures
from crowd.results.models import WorkerPulse

View = Callable[[HttpRequest], HttpResponse]


def monitors_only(view: View) -> View:
    """`view` for this machine and the networks that monitor it; 404 for all others."""

    @wraps(view)
    def answer(request: HttpRequest) -> HttpResponse:
        if not (is_this_machine(request) or is_within(request, settings.FRONTRUNNER_WATCHERS)):
            raise Http404
        return view(request)

    return answer


@require_safe
@never_cache
def healthz(request: HttpRequest) -> HttpResponse:  # noqa: ARG001
    """200 while the process answers; needs neither the database nor the broker."""
    return HttpResponse("ok\n", content_type="text/plain")


@require_safe
@never_cache
@monitors_only
def readyz(request: HttpRequest) -> HttpResponse:  # noqa: ARG001
    """200 if database and broker answer and `frontrunner admin prepare` ran, otherwise 503.

    Also the last task's age, the free disk space, and the fronts that clients are not offered until they are
    prepared again.

    A late worker does not make the server unready: submissions are stored, and summarised later. Nor does a
    full disk: everything can still be read.
    """
    state: dict[str, object] = {"database": _database(), "broker": broker.state()}
    if state["database"] == "ok":
        state["prepared"] = find_unprepared() or "ok"
    if state.get("prepared") == "ok":
        last = WorkerPulse.objects.order_by("-at").values_list("at", flat=True).first()
        state["seconds_since_last_task"] = round(_age(last), 1) if last else None
        state["sessions_waiting"] = session_figures.count_waiting()[0]
        state["fronts_to_prepare_again"] = list(plans.to_prepare())
    state["disk_free_bytes"] = shutil.disk_usage(settings.FRONTRUNNER_VAR).free
    ready = state["broker"] == state.get("prepared") == "ok"
    return JsonResponse(state, status=200 if ready else 503)


@require_safe
@never_cache
@monitors_only
def metrics(request: HttpRequest) -> HttpResponse:  # noqa: ARG001
    """Metrics in Prometheus' text format. Rows and queues are included while the database answers."""
    lines = [exposition.exposition(exposition.registry.rows()), *_program_gauges(), *_disk_gauges()]
    try:
        lines += [
            *_row_gauges(),
            *_queue_gauges(),
            gauge("database_up", "Whether the database answers", {"": 1}),
        ]
    except Error:
        lines.append(gauge("database_up", "Whether the database answers", {"": 0}))
    return HttpResponse("".join(lines), content_type="text/plain; version=0.0.4; charset=utf-8")


def _program_gauges() -> Iterator[str]:
    yield gauge("build_info", "The running version", {label("version", software_version()): 1})
    yield from processes.gauges(Path(settings.FRONTRUNNER_VAR) / "metrics")
    queue = settings.CELERY_TASK_DEFAULT_QUEUE
    messages = broker.waiting(queue)
    yield gauge("broker_up", "Whether the broker answers", {"": messages is not None})
    if messages is not None:
        yield gauge("queue_messages", "Messages that no worker has yet", {label("queue", queue): messages})


def _disk_gauges() -> Iterator[str]:
    disk = shutil.disk_usage(settings.FRONTRUNNER_VAR)
    yield gauge("disk_free_bytes", "Free on the disk of the data folder", {"": disk.free})
    yield gauge("disk_size_bytes", "Size of the disk of the data folder", {"": disk.total})


def _row_gauges() -> Iterator[str]:
    yield from row_counts.gauges()
    yield gauge("database_bytes", "Size of the database on its disk", {"": database_bytes()})


def _queue_gauges() -> Iterator[str]:
    waiting, oldest = session_figures.count_waiting()
    text = f"Sessions that wait for their summary, at most {session_figures.WAITING_LIMIT:,} of each kind"
    yield gauge("sessions_waiting", text, {"": waiting})
    yield gauge("oldest_waiting_session_seconds", "Age of the oldest of them", {"": _age(oldest)})
    pending = Evaluation.objects.filter(state=Evaluation.State.PENDING)
    oldest = pending.order_by().aggregate(at=Min("created_at"))["at"]
    yield gauge("evaluations_pending", "Evaluations that no worker has yet", {"": pending.count()})
    yield gauge("oldest_pending_evaluation_seconds", "Age of the oldest of them", {"": _age(oldest)})
    pulses = {label("task", pulse.task): _age(pulse.at) for pulse in WorkerPulse.objects.order_by("task")}
    yield gauge("task_age_seconds", "Since a worker last ran this task", pulses)


def _age(moment: datetime | None) -> float:
    """Seconds since `moment`, 0 without one."""
    return max(0.0, (timezone.now() - moment).total_seconds()) if moment else 0.0


def database_bytes() -> int:
    """Size of the database on its disk."""
    if connection.vendor == "postgresql":
        with connection.cursor() as cursor:
            cursor.execute("SELECT pg_database_size(current_database())")
            return int(cursor.fetchone()[0])
    name = Path(str(connection.settings_dict["NAME"]))
    files = (name, name.with_name(f"{name.name}-wal"))
    return sum(file.stat().st_size for file in files if file.exists())


def _database() -> str:
    try:
        with connection.cursor() as cursor:
            cursor.execute("SELECT 1")
    except Error as error:
        return f"does not answer: {type(error).__name__}"
    return "ok"
