"""Serves Django's WSGI application over ASGI, so that slow clients do not occupy threads.

The event loop reads a request's body, with a deadline and limits (`request_bodies`). Then one thread of a
small pool runs Django until the response is complete. The event loop sends the response and disconnects
clients that do not read. Requests beyond a number that wait are refused before their body is read, and one
whose client leaves while it waits never runs. docs/decisions/serving.md gives the reasons.
"""

import asyncio
import contextlib
import io
import logging
import random
import re
import resource
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable, MutableMapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import IO, Any
from urllib.parse import unquote_to_bytes

from django.conf import settings
from django.core.handlers.wsgi import WSGIRequest
from django.db import connections

from crowd.http import problems, request_bodies
from crowd.http.middleware import BODY_REFUSAL, method_label
from crowd.http.problems import Problem
from crowd.observability import metrics

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Headers = list[tuple[bytes, bytes]]

# Added to the API's own limit, so that the API can refuse a body that is slightly too large.
BODY_MARGIN_BYTES = 1 << 16
# The administration accepts a front as a file of up to crowd.fronts.content.front_file.LARGEST_FILE_BYTES.
ADMINISTRATION, ADMINISTRATION_BYTES = "/admin/", 5 << 20
CHUNK_BYTES = 1 << 16
# A streamed response is buffered in memory up to this size, beyond that in a file.
SPOOL_MEMORY_BYTES = 1 << 20
FILE_THREADS = 4
# Answered by the event loop: monitoring must not take a busy server for a dead one.
HEALTH = b"/healthz"
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
# Chunks, trajectories, plans, shaders and modules, which are named by their digests: the threads that read
# files run their requests, so that a download never waits behind requests.
BY_DIGEST = (b"/sequences/", b"/trajectories/", b"/plans/", b"/shaders/", b"/modules/")
# A refused client waits for a random time within this range, so that not all come back at once.
BUSY_SECONDS = (2, 10)
# Each connection uses one file descriptor, each download one more.
MAX_OPEN_FILES = 16_384

log = logging.getLogger(__name__)


@dataclass
class CompleteResponse:
    """A response with its `content`, or a `file` to read it from; `close` releases its resources."""

    status: int
    headers: Headers
    content: bytes = b""
    file: IO[bytes] | None = None
    close: Callable[[], None] | None = None


class Handler:
    """An ASGI 3 application ("http" and "lifespan") around a Django `wsgi` application.

    One event loop uses it. The threads live as long as the process: each keeps its database connection.
    """

    def __init__(self, wsgi: Callable[..., Any]) -> None:
        self._wsgi = wsgi
        threads = settings.FRONTRUNNER_WEB_THREADS
        # Reading goes on while all writers wait for the database.
        writers = max(1, threads // 2)
        self._writers = ThreadPoolExecutor(writers, thread_name_prefix="writer")
        self._readers = ThreadPoolExecutor(max(1, threads - writers), thread_name_prefix="reader")
        self._queued = {"requests": 0, "downloads": 0}
        # Downloads never wait for requests, and requests never for a slow disk: each have their own number.
        self._files = ThreadPoolExecutor(FILE_THREADS, thread_name_prefix="file")
        self._bodies = request_bodies.MemoryPool(settings.FRONTRUNNER_MAX_BODIES_BYTES)

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await _run_lifespan(receive, send)
            return
        if scope["raw_path"] == HEALTH and scope["method"] in {"GET", "HEAD"}:
            await _send_health(scope["method"], send)
            return
        kind = _kind(scope)
        if self._is_full(kind):
            await _send_busy(scope, send)
            return
        share = request_bodies.MemoryShare(self._bodies)
        try:
            environ = await _complete_environ(scope, receive, share)
            if self._is_full(kind):
                await _send_busy(scope, send)
                return
            # Of a refused body nothing more is read, so that the server closes its connection.
            waiting = asyncio.Event().wait() if BODY_REFUSAL in environ else _wait_for_disconnect(receive)
            disconnect: asyncio.Future[Any] = asyncio.ensure_future(waiting)
            try:
                complete = await self._complete_response(environ, kind, disconnect)
                share.release()
                if complete is not None:
                    await self._send(complete, disconnect, send)
            finally:
                disconnect.cancel()
        finally:
            share.release()

    def _is_full(self, kind: str) -> bool:
        return self._queued[kind] >= settings.FRONTRUNNER_MAX_WAITING

    async def _complete_response(
        self, environ: dict[str, Any], kind: str, disconnect: asyncio.Future[Any]
    ) -> CompleteResponse | None:
        """Django's response; None if the client left while the request waited for a thread."""
        pool = self._readers if environ["REQUEST_METHOD"] in SAFE_METHODS else self._writers
        self._queued[kind] += 1
        try:
            running: Future[CompleteResponse] = (
                self._files.submit(self._run_download, environ)
                if kind == "downloads"
                else pool.submit(self._run_django, environ)
            )
            response = asyncio.wrap_future(running)
            either: set[asyncio.Future[Any]] = {response, disconnect}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if not response.done() and running.cancel():
                return None
            return await response
        finally:
            self._queued[kind] -= 1

    def _run_download(self, environ: dict[str, Any]) -> CompleteResponse:
        """As `_run_django`, in a thread that keeps no connection to the database."""
        try:
            return self._run_django(environ)
        finally:
            connections.close_all()

    def _run_django(self, environ: dict[str, Any]) -> CompleteResponse:
        """Django's response, made in a thread of the pool."""
        started: list[tuple[str, list[tuple[str, str]]]] = []
        response: Any = self._wsgi(environ, lambda *start: started.append(start[:2]))
        status, headers = started[0]
        complete = CompleteResponse(int(status[:3]), _encode_headers(headers))
        if environ["REQUEST_METHOD"] == "HEAD":
            response.close()
        elif not response.streaming:
            complete.content = response.content
            response.close()
        elif getattr(response, "file_to_stream", None) is not None:
            complete.file, complete.close = response.file_to_stream, response.close
        else:
            return _spool_stream(complete, response, environ)
        return complete

    async def _send(self, complete: CompleteResponse, disconnect: asyncio.Future[Any], send: Send) -> None:
        """Send `complete` in chunks until the client disconnects or reads nothing for
        FRONTRUNNER_SEND_SECONDS.

        The server closes the connection if a response is shorter than its Content-Length.
        """
        try:
            await send(
                {"type": "http.response.start", "status": complete.status, "headers": complete.headers}
            )
            if complete.file is None and len(complete.content) <= CHUNK_BYTES:
                await send({"type": "http.response.body", "body": complete.content})
                return
            async for chunk in self._chunks(complete):
                if disconnect.done():
                    return
                async with asyncio.timeout(settings.FRONTRUNNER_SEND_SECONDS):
                    await send({"type": "http.response.body", "body": chunk, "more_body": True})
            await send({"type": "http.response.body", "body": b""})
        except TimeoutError:
            log.info("disconnected a client that read nothing for %d s", settings.FRONTRUNNER_SEND_SECONDS)
        finally:
            if complete.close is not None:
                await asyncio.get_running_loop().run_in_executor(self._files, complete.close)

    async def _chunks(self, complete: CompleteResponse) -> AsyncIterator[bytes]:
        if complete.file is None:
            for start in range(0, len(complete.content), CHUNK_BYTES):
                yield complete.content[start : start + CHUNK_BYTES]
            return
        loop, read = asyncio.get_running_loop(), complete.file.read
        while chunk := await loop.run_in_executor(self._files, read, CHUNK_BYTES):
            yield chunk


def raise_open_file_limit() -> None:
    """Raise this process's limit on open files to MAX_OPEN_FILES, or to what the system allows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_OPEN_FILES if hard == resource.RLIM_INFINITY else min(MAX_OPEN_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError, OSError):  # macOS allows fewer than it reports
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def wsgi_environ(scope: Message) -> dict[str, Any]:
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


def _kind(scope: Message) -> str:
    """Whether a request is one of the "downloads" by digest, or of the other "requests"."""
    is_download = scope["method"] in SAFE_METHODS and scope["raw_path"].startswith(BY_DIGEST)
    return "downloads" if is_download else "requests"


async def _run_lifespan(receive: Receive, send: Send) -> None:
    while (message := await receive())["type"] != "lifespan.shutdown":
        await send({"type": f"{message['type']}.complete"})
    await send({"type": "lifespan.shutdown.complete"})


async def _send_health(method: str, send: Send) -> None:
    content = b"" if method == "HEAD" else b"ok\n"
    headers = [(b"Content-Type", b"text/plain"), (b"Cache-Control", b"no-store")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": content})


async def _send_busy(scope: Message, send: Send) -> None:
    """503 with a random Retry-After, counted in the metrics."""
    problem = Problem(
        "busy",
        f"{settings.FRONTRUNNER_MAX_WAITING} requests wait already: nothing was read or stored",
        retry_after=random.randint(*BUSY_SECONDS),
    )
    refusal = problem.response()
    if re.match(settings.CORS_URLS_REGEX, scope["path"]):
        refusal["Access-Control-Allow-Origin"] = "*"
        refusal["Access-Control-Expose-Headers"] = "Retry-After"
    method, status = method_label(scope["method"]), str(refusal.status_code)
    metrics.registry.observe("request_seconds", 0.0, method, "busy", status)
    headers = _encode_headers(list(refusal.items()))
    await send({"type": "http.response.start", "status": refusal.status_code, "headers": headers})
    await send({"type": "http.response.body", "body": refusal.content})


async def _complete_environ(
    scope: Message, receive: Receive, share: request_bodies.MemoryShare
) -> dict[str, Any]:
    """The WSGI environment with the body, or with the Problem of a refused body as BODY_REFUSAL."""
    environ = wsgi_environ(scope)
    content, declared = b"", environ.get("CONTENT_LENGTH", "")
    if declared not in {"", "0"} or "HTTP_TRANSFER_ENCODING" in environ:
        limit, seconds = _size_limit(environ["PATH_INFO"]), settings.FRONTRUNNER_BODY_SECONDS
        length = int(declared) if declared.isdecimal() else None
        try:
            content = await request_bodies.read_body(receive, share, limit, seconds, length)
        except Problem as problem:
            environ[BODY_REFUSAL] = problem
    # The body is complete now, with or without chunks.
    environ.pop("HTTP_TRANSFER_ENCODING", None)
    return environ | {"CONTENT_LENGTH": str(len(content)), "wsgi.input": io.BytesIO(content)}


def _size_limit(path: str) -> int:
    limit = int(settings.FRONTRUNNER_MAX_BODY_BYTES) + BODY_MARGIN_BYTES
    return max(limit, ADMINISTRATION_BYTES) if path.startswith(ADMINISTRATION) else limit


def _encode_headers(headers: list[tuple[str, str]]) -> Headers:
    return [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers]


def _spool_stream(complete: CompleteResponse, response: Any, environ: dict[str, Any]) -> CompleteResponse:
    """Buffer everything that `response` streams in a temporary file, so that no slow reader holds the
    database.

    If the stream fails, nothing is sent yet: the response is a complete 500.
    """
    spool: IO[bytes] = tempfile.SpooledTemporaryFile(SPOOL_MEMORY_BYTES)  # noqa: SIM115
    try:
        for chunk in response:
            spool.write(chunk)
    except Exception:
        log.exception("a streamed response failed before it was complete")
        spool.close()
        refusal = problems.server_error_view(WSGIRequest(environ))
        return CompleteResponse(refusal.status_code, _encode_headers(list(refusal.items())), refusal.content)
    finally:
        response.close()
    complete.headers.append((b"Content-Length", str(spool.tell()).encode()))
    spool.seek(0)
    complete.file, complete.close = spool, spool.close
    return complete


async def _wait_for_disconnect(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
