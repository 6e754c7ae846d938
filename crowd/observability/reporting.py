"""Errors go to Sentry and traces to OpenTelemetry where the environment names who receives them.

Neither gets an address, a header, a query or a body of a participant's request, nor values of variables.
"""

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import groundwork
from crowd.observability.environment import SettingError

if TYPE_CHECKING:
    from django.http import HttpRequest
    from opentelemetry.trace import Span
    from sentry_sdk.types import Event, Hint

TRACES = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
# Of a request; its route and its status come later.
KEPT = {"http.method", "http.request.method", "http.scheme", "url.scheme"}


def start(**_: object) -> None:
    """Start what SENTRY_DSN and OTEL_EXPORTER_OTLP_ENDPOINT ask for, before the first request or task.

    Raises SettingError if the packages are missing, or the DSN is not one.
    """
    if os.environ.get("SENTRY_DSN"):
        _start("SENTRY_DSN", _report_errors)
    for name in TRACES:
        if os.environ.get(name):
            _start(name, _trace)
            break


def _start(variable: str, begin: Callable[[], None]) -> None:
    try:
        begin()
    except ImportError as error:
        raise SettingError(
            f"{variable} is set, but {error.name} is missing: remove it, or install the packages with "
            "python -m pip install --require-hashes -r requirements-monitoring.lock"
        ) from error


def _report_errors() -> None:
    import sentry_sdk
    from sentry_sdk.utils import BadDsn

    try:
        sentry_sdk.init(
            release=groundwork.__version__,
            before_send=_without_participant,
            include_local_variables=False,
            max_breadcrumbs=0,
            max_request_body_size="never",
            send_default_pii=False,
        )
    except BadDsn as error:
        raise SettingError(
            f"SENTRY_DSN={os.environ['SENTRY_DSN']}: {error}; copy it from the project's settings in Sentry"
        ) from error


def _without_participant(event: "Event", _: "Hint") -> "Event":
    if request := event.get("request"):
        event["request"] = {"method": request.get("method")}  # an address may be a private page's
    return event


def _trace() -> None:
    from opentelemetry import trace
    from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
    from opentelemetry.instrumentation.celery import CeleryInstrumentor
    from opentelemetry.instrumentation.django import DjangoInstrumentor
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import BatchSpanProcessor

    os.environ.setdefault("OTEL_SERVICE_NAME", "frontrunner")
    provider = TracerProvider(resource=Resource.create({"service.version": groundwork.__version__}))
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)
    DjangoInstrumentor().instrument(request_hook=_forget_participant)
    CeleryInstrumentor().instrument()  # type: ignore[no-untyped-call]


def _forget_participant(span: "Span", _: "HttpRequest") -> None:
    attributes: Any = getattr(span, "attributes", None) or {}
    for name in set(attributes) - KEPT:
        span.set_attribute(name, "")
