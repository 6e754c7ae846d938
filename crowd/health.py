"""For those who run the server: is it alive, can it work, how much has it done."""

from django.db import Error, connection
from django.http import HttpRequest, HttpResponse, JsonResponse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe
from kombu.exceptions import KombuError, OperationalError

from crowd.celery import app
from crowd.devices.models import DeviceModel, Installation
from crowd.results import summarising
from crowd.results.models import MeasurementSession, Run, Submission, WorkerPulse

BROKER_PATIENCE_SECONDS = 2


@require_safe
@never_cache
def healthz(request: HttpRequest) -> HttpResponse:  # noqa: ARG001
    """200 while the process answers; asks nothing of the database or the broker."""
    return HttpResponse("ok\n", content_type="text/plain")


@require_safe
@never_cache
def readyz(request: HttpRequest) -> HttpResponse:  # noqa: ARG001
    """200 when database and broker answer, else 503; and how long ago a worker last ran a task.

    A late worker does not make the server unready: what is sent is stored, and summarised when a worker
    is back.
    """
    state: dict[str, object] = {"database": _database(), "broker": _broker()}
    if state["database"] == "ok":
        last = WorkerPulse.objects.order_by("-at").values_list("at", flat=True).first()
        state["seconds_since_last_task"] = round((timezone.now() - last).total_seconds(), 1) if last else None
        state["sessions_waiting"] = summarising.waiting().count()
    ready = state["database"] == state["broker"] == "ok"
    return JsonResponse(state, status=200 if ready else 503)


@require_safe
@never_cache
def metrics(request: HttpRequest) -> HttpResponse:  # noqa: ARG001
    """Counts in Prometheus' text format."""
    counts = {
        "installations": ("Enrolled installations", Installation.objects.count()),
        "devices": ("Device models", DeviceModel.objects.count()),
        "submissions": ("Accepted submissions", Submission.objects.count()),
        "sessions": ("Measurement sessions", MeasurementSession.objects.count()),
        "sessions_waiting": ("Sessions that wait for their summary", summarising.waiting().count()),
        "runs": ("Runs", Run.objects.count()),
    }
    lines = [
        f"# HELP frontrunner_{name} {text}\n# TYPE frontrunner_{name} gauge\nfrontrunner_{name} {count}\n"
        for name, (text, count) in counts.items()
    ]
    return HttpResponse("".join(lines), content_type="text/plain; version=0.0.4; charset=utf-8")


def _database() -> str:
    try:
        with connection.cursor() as cursor:
            cursor.execute("SELECT 1")
    except Error as error:
        return f"does not answer: {type(error).__name__}"
    return "ok"


def _broker() -> str:
    try:
        with app.connection_for_write(connect_timeout=BROKER_PATIENCE_SECONDS) as broker:
            broker.ensure_connection(max_retries=1, timeout=BROKER_PATIENCE_SECONDS)
    except (KombuError, OperationalError, OSError) as error:
        return f"does not answer: {type(error).__name__}"
    return "ok"
