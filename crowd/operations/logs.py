"""What the server's programs log: a line an event, with the request it belongs to and nothing of who asked.

`text` is for people (NAME=VALUE at the end), `json` for programs: one object a line with time, level, logger,
message, request_id, what the event adds, and the traceback in `exception`. A request's id travels with the
messages that it sends, so that its line and those of the tasks that it caused are found together.
"""

import json
import logging
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Any

from django.conf import settings
from django.http import HttpRequest

# Of the request that is being answered here, or that caused the running task; empty where there is none.
request_id: ContextVar[str] = ContextVar("request_id", default="")

HEADER = "request_id"  # in messages of the broker


def more(**values: object) -> dict[str, dict[str, object]]:
    """For a logging call's `extra`: members of the JSON object, NAME=VALUE in text."""
    return {"more": values}


class TextFormatter(logging.Formatter):
    """Lines for people."""

    def __init__(self) -> None:
        super().__init__("{asctime} {levelname} {name} {message}", style="{")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        added = "".join(f" {name}={value}" for name, value in _added(record).items())
        return super().formatMessage(record) + added


class JsonFormatter(logging.Formatter):
    """One JSON object a line; a traceback's lines are one string."""

    def format(self, record: logging.LogRecord) -> str:
        entry: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname,
            "logger": record.name,
            "message": record.getMessage(),
            **_added(record),
        }
        if record.exc_info:
            entry["exception"] = self.formatException(record.exc_info)
        return json.dumps(entry, ensure_ascii=False, default=str)


class WithoutAddress(logging.Filter):
    """Puts the pattern of a request's address in place of the address, in what Django says of it.

    An address may be a secret, as that of a participant's own page.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        request = getattr(record, "request", None)
        if isinstance(request, HttpRequest) and isinstance(record.args, tuple):
            # Django escapes what it puts in.
            escaped = request.path.encode("unicode_escape").decode("ascii")
            shown = f"/{endpoint(request)}"
            record.args = tuple(shown if each in (request.path, escaped) else each for each in record.args)
        return True


def endpoint(request: HttpRequest) -> str:
    """The pattern that answered, as api/v1/submissions/<uuid:key>; "static" and "unmatched" beside these."""
    if request.resolver_match is not None:
        return request.resolver_match.route
    return "static" if request.path_info.startswith(settings.STATIC_URL) else "unmatched"


def _added(record: logging.LogRecord) -> dict[str, object]:
    present = request_id.get()
    added: dict[str, object] = {"request_id": present} if present else {}
    return added | getattr(record, "more", {})


def send_along(headers: dict[str, Any], **_: Any) -> None:
    """Celery's signal before a message leaves: it carries the id of the request that sends it."""
    present = request_id.get()
    if present:
        headers[HEADER] = present


def take_up(task: Any, **_: Any) -> None:
    """Celery's signal before a task runs: what it logs names the request that caused it, or nothing."""
    if not task.request.is_eager:  # else it runs within that request
        request_id.set(str(task.request.get(HEADER) or ""))
