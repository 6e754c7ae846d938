"""The embedded broker: kombu's filesystem transport, safe from kill -9 and from its own readers.

kombu creates a message's file and then fills it. A worker that reads in between gets an empty message and
crashes. A process killed in between leaves an empty message, or an empty table of bindings, forever. Here a
file gets its name once it is complete. Other files are moved to a folder: a message is only a hint.
"""

import logging
import os
import time
import uuid
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Empty
from typing import Any

from kombu.transport import filesystem
from kombu.utils.json import dumps, loads

DEAD_LETTERS = "dead-letters"  # a folder beside the messages, for people to look at

log = logging.getLogger(__name__)


class Channel(filesystem.Channel):
    """Messages and bindings in files that are created, replaced and deleted atomically."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)  # type: ignore[no-untyped-call]
        self._listed: dict[str, deque[str]] = {}

    def _put(self, queue: str, payload: Any, **_: Any) -> None:  # type: ignore[override]
        # The time comes first: messages are taken in the order of their names.
        name = f"{time.time_ns()}_{uuid.uuid4()}.{queue}.msg"
        _write(Path(self.data_folder_out) / name, payload)

    def _get(self, queue: str, timeout: float | None = None) -> Any:  # noqa: ARG002 - kombu's signature
        listed = self._listed.setdefault(queue, deque())
        if not listed:
            # Newer messages sort after all of these: the folder is listed again when these are consumed.
            names = os.listdir(self.data_folder_in)
            listed.extend(sorted(name for name in names if name.partition(".")[2] == f"{queue}.msg"))
        while listed:
            name = listed.popleft()
            path = os.path.join(self.data_folder_in, name)
            try:
                content = Path(path).read_bytes()
                os.unlink(path)
            except OSError:
                continue  # another worker removed it first, and has it
            if (message := _message(content)) is not None:
                return message
            self._set_aside(name, content)
        raise Empty

    def _set_aside(self, name: str, content: bytes) -> None:
        folder = Path(self.data_folder_in) / DEAD_LETTERS
        folder.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
        log.warning("%s cannot be read as a message and was moved to %s", name, folder)

    def get_table(self, exchange: str) -> list[Any]:
        try:
            return list(super().get_table(exchange))  # type: ignore[no-untyped-call]
        except ValueError:
            return []  # the next binding repairs it

    def _queue_bind(self, exchange: str, routing_key: str, pattern: str, queue: str) -> None:
        binding = filesystem.exchange_queue_t(routing_key or "", pattern or "", queue or "")
        with self._locked_bindings():
            table = self.get_table(exchange)
            if binding not in table:
                file = self._exchange_file(exchange)  # type: ignore[no-untyped-call]
                _write(file, [binding, *table])

    @contextmanager
    def _locked_bindings(self) -> Iterator[None]:
        """Keep other processes from changing bindings."""
        self.control_folder.mkdir(exist_ok=True)
        with (self.control_folder / ".lock").open("w") as file:
            filesystem.lock(file, filesystem.LOCK_EX)
            yield


class Transport(filesystem.Transport):
    """kombu's filesystem transport with the channel above."""

    Channel = Channel


def _message(content: bytes) -> dict[str, Any] | None:
    """The message in `content` as a worker needs it; None if it is not one."""
    try:
        message = loads(content)
    except ValueError:
        return None
    properties = message.get("properties") if isinstance(message, dict) else None
    if not isinstance(properties, dict) or "body" not in message:
        return None
    delivery = properties.get("delivery_info")
    return message if "delivery_tag" in properties and isinstance(delivery, dict) else None


def _write(path: Path, content: Any) -> None:
    """Create or replace the file at `path` atomically: readers see the old content or all of `content`."""
    unfinished = path.with_name(f".{uuid.uuid4()}")
    unfinished.write_text(dumps(content))
    os.replace(unfinished, path)
