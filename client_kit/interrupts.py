"""Signals that end the client: they act as Ctrl-C, and are ignored while a session is stored."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# SIGHUP, a closed terminal, is not on every platform.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


def as_ctrl_c() -> None:
    """Have every terminating signal raise KeyboardInterrupt, except those that nohup or a shell ignores."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


@contextmanager
def ignored() -> Iterator[None]:
    """Ignore terminating signals for a moment; only the main thread receives them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
