"""The command line of the web server."""

import sys

APPLICATION = "crowd.asgi:application"
# Timeout for a request's first line and headers, and for the next request of a kept-alive connection.
HEADER_MILLISECONDS = 15_000
# Connections that one process accepts at a time; further ones wait.
CONNECTIONS = 4096
OPTIONS = (
    *("--interface", "asgi", "--no-ws"),
    # With HTTP/2 allowed, granian waits forever for the first byte of a connection.
    *("--http", "1", "--http1-header-read-timeout", str(HEADER_MILLISECONDS)),
    *("--backpressure", str(CONNECTIONS)),
    *("--respawn-failed-workers", "--log-level", "warning"),
)


def command(host: str, port: int | str, *more: str) -> list[str]:
    """The command line of one web server process at `host` and `port`, with `more` of granian's options."""
    address = ("--host", host, "--port", str(port))
    return [sys.executable, "-m", "granian", *OPTIONS, *address, *more, APPLICATION]
