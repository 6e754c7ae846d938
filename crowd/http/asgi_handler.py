"""Serves Django's WSGI application over ASGI, where slow clients cost no thread.

The event loop reads a request's body, with a deadline and limits (`request_bodies`). Then one thread of a
small pool runs Django until its answer is complete. The event loop sends the answer and drops clients that do
not read. docs/decisions/serving.md gives the reasons.
"""

import asyncio
import contextlib
import io
import logging
import resource
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import IO, Any
from urllib.parse import unquote_to_bytes

from django.conf import settings
from django.core.handlers.wsgi import WSGIRequest

from crowd.http import problems, request_bodies
from crowd.http.middleware import BODY_REFUSAL
from crowd.http.problems import Problem

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Headers = list[tuple[bytes, bytes]]

# Above the API's own limit, so that the API refuses what is slightly too large in its own words.
ROOM_BYTES = 1 << 16
# The administration takes a front as a file of up to crowd.fronts.content.front_file.LARGEST_FILE_BYTES.
ADMINISTRATION, ADMINISTRATION_BYTES = "/admin/", 5 << 20
PIECE_BYTES = 1 << 16
# An answer of unknown length is kept in memory up to this size, beyond that in a file.
SPOOLED_BYTES = 1 << 20
FILE_THREADS = 4
# Each connection has a descriptor, and each download one more.
OPEN_FILES = 16_384

log = logging.getLogger(__name__)


@dataclass
class Answer:
    """A complete answer: `content`, or a `file` to read it from; `close` releases what it holds."""

    status: int
    headers: Headers
    content: bytes = b""
    file: IO[bytes] | None = None
    close: Callable[[], None] | None = None


class Handler:
    """An ASGI 3 application ("http" and "lifespan") around a Django WSGI application.

    One event loop uses it. The threads live as long as the process: each keeps its database connection.
    """

    def __init__(self, wsgi: Callable[..., Any]) -> None:
        self._wsgi = wsgi
        self._requests = ThreadPoolExecutor(settings.FRONTRUNNER_WEB_THREADS, thread_name_prefix="request")
        # Downloads never wait for requests, and requests never for a slow disk.
        self._files = ThreadPoolExecutor(FILE_THREADS, thread_name_prefix="file")
        self._bodies = request_bodies.Pool(settings.FRONTRUNNER_MAX_BODIES_BYTES)

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await _confirm_lifespan(receive, send)
            return
        loop = asyncio.get_running_loop()
        share = request_bodies.Share(self._bodies)
        try:
            environ = await _complete_environ(scope, receive, share)
            answer = await loop.run_in_executor(self._requests, self._answer, environ)
        finally:
            share.release()
        try:
            await self._send(answer, receive, send)
        finally:
            if answer.close is not None:
                await loop.run_in_executor(self._requests, answer.close)

    def _answer(self, environ: dict[str, Any]) -> Answer:
        """Django's answer, made in a thread of the pool."""
        started: list[tuple[str, list[tuple[str, str]]]] = []
        response: Any = self._wsgi(environ, lambda *start: started.append(start[:2]))
        status, headers = started[0]
        answer = Answer(int(status[:3]), _encoded(headers))
        if environ["REQUEST_METHOD"] == "HEAD":
            response.close()
        elif not response.streaming:
            answer.content = response.content
            response.close()
        elif getattr(response, "file_to_stream", None) is not None:
            answer.file, answer.close = response.file_to_stream, response.close
        else:
            return _spooled(answer, response, environ)
        return answer

    async def _send(self, answer: Answer, receive: Receive, send: Send) -> None:
        """Send ANSWER in pieces, until the client hangs up or reads nothing for FRONTRUNNER_SEND_SECONDS.

        The server closes the connection of an answer that is shorter than its Content-Length.
        """
        await send({"type": "http.response.start", "status": answer.status, "headers": answer.headers})
        if answer.file is None and len(answer.content) <= PIECE_BYTES:
            await send({"type": "http.response.body", "body": answer.content})
            return
        hang_up = asyncio.ensure_future(_wait_for_hang_up(receive))
        try:
            async for piece in self._pieces(answer):
                if hang_up.done():
                    return
                async with asyncio.timeout(settings.FRONTRUNNER_SEND_SECONDS):
                    await send({"type": "http.response.body", "body": piece, "more_body": True})
            await send({"type": "http.response.body", "body": b""})
        except TimeoutError:
            log.info("a client was dropped: it read nothing for %d s", settings.FRONTRUNNER_SEND_SECONDS)
        finally:
            hang_up.cancel()

    async def _pieces(self, answer: Answer) -> AsyncIterator[bytes]:
        if answer.file is None:
            for start in range(0, len(answer.content), PIECE_BYTES):
                yield answer.content[start : start + PIECE_BYTES]
            return
        loop, read = asyncio.get_running_loop(), answer.file.read
        while piece := await loop.run_in_executor(self._files, read, PIECE_BYTES):
            yield piece


def allow_open_files() -> None:
    """Raise this process's limit on open files to OPEN_FILES, or as far as the system allows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = OPEN_FILES if hard == resource.RLIM_INFINITY else min(OPEN_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError, OSError):  # macOS allows fewer than it reports
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def environ_of(scope: Message) -> dict[str, Any]:
    """The WSGI environment of an ASGI request, without its body (PEP 3333: bytes as Latin-1 text)."""
    server, client = scope.get("server") or ("", 0), scope.get("client") or ("", 0)
    environ: dict[str, Any] = {
        "REQUEST_METHOD": scope["method"],
        "SCRIPT_NAME": "",
        "PATH_INFO": unquote_to_bytes(scope["raw_path"]).decode("latin-1"),
        "QUERY_STRING": scope["query_string"].decode("latin-1"),
        "SERVER_NAME": server[0],
        "SERVER_PORT": str(server[1]),
        "SERVER_PROTOCOL": f"HTTP/{scope['http_version']}",
        "REMOTE_ADDR": client[0],
        "wsgi.version": (1, 0),
        "wsgi.url_scheme": scope["scheme"],
        "wsgi.errors": sys.stderr,
        "wsgi.multithread": True,
        "wsgi.multiprocess": True,
        "wsgi.run_once": False,
    }
    for raw_name, raw_value in scope["headers"]:
        if b"_" in raw_name:
            continue  # X_Forwarded_For would pass for X-Forwarded-For
        name, value = raw_name.decode("latin-1").upper().replace("-", "_"), raw_value.decode("latin-1")
        key = name if name in {"CONTENT_LENGTH", "CONTENT_TYPE"} else f"HTTP_{name}"
        separator = "; " if name == "COOKIE" else ","
        environ[key] = f"{environ[key]}{separator}{value}" if key in environ else value
    return environ


async def _confirm_lifespan(receive: Receive, send: Send) -> None:
    while (message := await receive())["type"] != "lifespan.shutdown":
        await send({"type": f"{message['type']}.complete"})
    await send({"type": "lifespan.shutdown.complete"})


async def _complete_environ(scope: Message, receive: Receive, share: request_bodies.Share) -> dict[str, Any]:
    """The WSGI environment with the body; of a refused body it has the Problem as BODY_REFUSAL."""
    environ = environ_of(scope)
    content, declared = b"", environ.get("CONTENT_LENGTH", "")
    if declared not in {"", "0"} or "HTTP_TRANSFER_ENCODING" in environ:
        limit, seconds = _size_limit(environ["PATH_INFO"]), settings.FRONTRUNNER_BODY_SECONDS
        length = int(declared) if declared.isdecimal() else None
        try:
            content = await request_bodies.read(receive, share, limit, seconds, length)
        except Problem as problem:
            environ[BODY_REFUSAL] = problem
    # Whatever way the body came, it is whole now.
    environ.pop("HTTP_TRANSFER_ENCODING", None)
    return environ | {"CONTENT_LENGTH": str(len(content)), "wsgi.input": io.BytesIO(content)}


def _size_limit(path: str) -> int:
    limit = int(settings.FRONTRUNNER_MAX_BODY_BYTES) + ROOM_BYTES
    return max(limit, ADMINISTRATION_BYTES) if path.startswith(ADMINISTRATION) else limit


def _encoded(headers: list[tuple[str, str]]) -> Headers:
    return [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers]


def _spooled(answer: Answer, response: Any, environ: dict[str, Any]) -> Answer:
    """ANSWER with everything that RESPONSE streams in a temporary file, so that no reader holds the database.

    Where the stream fails, no byte is sent yet: the answer is a complete refusal.
    """
    spool: IO[bytes] = tempfile.SpooledTemporaryFile(SPOOLED_BYTES)  # noqa: SIM115
    try:
        for piece in response:
            spool.write(piece)
    except Exception:
        log.exception("an answer failed before it was complete")
        spool.close()
        refusal = problems.unforeseen(WSGIRequest(environ))
        return Answer(refusal.status_code, _encoded(list(refusal.items())), refusal.content)
    finally:
        response.close()
    answer.headers.append((b"Content-Length", str(spool.tell()).encode()))
    spool.seek(0)
    answer.file, answer.close = spool, spool.close
    return answer


async def _wait_for_hang_up(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
