"""What the system's signals to end do to the client: they are Ctrl-C, and wait while a session is kept."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# SIGHUP, a closed terminal, is not on every platform.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


def as_ctrl_c() -> None:
    """Have every signal to end raise KeyboardInterrupt, but for those that nohup or a shell switched off."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


@contextmanager
def ignored() -> Iterator[None]:
    """Ignore signals to end for a moment; no other thread than the main one hears them anyway."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
