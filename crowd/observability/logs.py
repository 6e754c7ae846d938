"""Log formats: one line per event, with the id of its request and without data about the client.

`text` is for people (NAME=VALUE at the end). `json` is for programs: one object per line with time, level,
logger, message, request_id, the fields of the event, and the traceback in `exception`. A request's id travels
with the messages that it sends, so that the lines of a request and of its tasks can be found together.
"""

import json
import logging
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Any

from django.conf import settings
from django.http import HttpRequest

# The id of the current request, or of the request that caused the running task; empty without one.
request_id: ContextVar[str] = ContextVar("request_id", default="")

HEADER = "request_id"  # in messages of the broker


def fields(**values: object) -> dict[str, dict[str, object]]:
    """The `extra` of a logging call: members of the JSON object, NAME=VALUE in text."""
    return {"fields": values}


class TextFormatter(logging.Formatter):
    """Lines for people."""

    def __init__(self) -> None:
        super().__init__("{asctime} {levelname} {name} {message}", style="{")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        added = "".join(f" {name}={value}" for name, value in _fields_of(record).items())
        return super().formatMessage(record) + added


class JsonFormatter(logging.Formatter):
    """One JSON object per line; a traceback is one string."""

    def format(self, record: logging.LogRecord) -> str:
        entry: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname,
            "logger": record.name,
            "message": record.getMessage(),
            **_fields_of(record),
        }
        if record.exc_info:
            entry["exception"] = self.formatException(record.exc_info)
        return json.dumps(entry, ensure_ascii=False, default=str)


class WithoutAddress(logging.Filter):
    """Replaces the address of a request by its URL pattern in messages of Django.

    An address may be a secret, such as that of a participant's private page.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        request = getattr(record, "request", None)
        if isinstance(request, HttpRequest) and isinstance(record.args, tuple):
            # Django escapes the path in its messages.
            escaped = request.path.encode("unicode_escape").decode("ascii")
            shown = f"/{endpoint(request)}"
            record.args = tuple(shown if each in (request.path, escaped) else each for each in record.args)
        return True


def endpoint(request: HttpRequest) -> str:
    """The URL pattern of `request`, as api/v1/submissions/<uuid:key>; otherwise "static" or "unmatched"."""
    if request.resolver_match is not None:
        return request.resolver_match.route
    return "static" if request.path_info.startswith(settings.STATIC_URL) else "unmatched"


def _fields_of(record: logging.LogRecord) -> dict[str, object]:
    current = request_id.get()
    added: dict[str, object] = {"request_id": current} if current else {}
    return added | getattr(record, "fields", {})


def add_request_id(headers: dict[str, Any], **_: Any) -> None:
    """Before Celery sends a message, add the id of the current request to it."""
    current = request_id.get()
    if current:
        headers[HEADER] = current


def set_request_id(task: Any, **_: Any) -> None:
    """Before Celery runs a task, set the id of the request that caused it."""
    if not task.request.is_eager:  # an eager task runs within its request
        request_id.set(str(task.request.get(HEADER) or ""))
