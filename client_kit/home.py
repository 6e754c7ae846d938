"""The folder with this installation's data."""

import json
import os
import sqlite3
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from client_kit.errors import HomeError


class Home:
    """A private folder of small JSON documents, cached sequences, their decoded depth and the spool.

    Documents are replaced atomically: a process killed while writing leaves the old one in place.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def prepare(self) -> None:
        """Make the folder, for its owner only. Raises HomeError when it cannot be written."""
        try:
            self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
            with tempfile.TemporaryFile(dir=self.path):
                pass
        except OSError as error:
            raise self._unusable(error) from error

    @property
    def spool(self) -> Path:
        """The database of measured sessions."""
        return self.path / "spool.sqlite3"

    def sequence(self, sha256: str) -> Path:
        """The folder of the sequence with this digest, existing or not."""
        return self.path / "sequences" / sha256

    @property
    def decoded(self) -> Path:
        """The folder of decoded depth, which evaluations share. It may be deleted."""
        return self.path / "decoded"

    def trajectory(self, sha256: str) -> Path:
        """The file of the reference trajectory with this digest, existing or not."""
        return self.path / "trajectories" / sha256

    def read(self, name: str) -> dict[str, Any]:
        """The document of that name, or an empty one. Raises HomeError when it is damaged."""
        path = self.path / name
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}
        except OSError as error:
            raise self._unusable(error) from error
        except ValueError as error:
            raise HomeError(f"{path} is damaged ({error}): move it away and start again") from error
        if not isinstance(document, dict):
            raise HomeError(f"{path} is damaged (not a JSON object): move it away and start again")
        return document

    def write(self, name: str, document: Mapping[str, Any]) -> None:
        """Replace the document of that name and sync it; only its owner may read it."""
        data = json.dumps(document, indent=1, sort_keys=True).encode()
        write_file(self.path / name, data)

    def remove(self, name: str) -> None:
        """Delete the document of that name, if it exists."""
        with suppress(FileNotFoundError):
            (self.path / name).unlink()

    @contextmanager
    def only_one(self, purpose: str, *, wait: bool = False) -> Iterator[bool]:
        """Hold a lock shared by all processes of this folder; yields False when another one holds it.

        With `wait` it waits until Ctrl-C. It is SQLite's lock, which works on every platform and ends with
        its process.
        """
        path = self.path / f"{purpose}.lock"
        try:
            # In steps of a second: SQLite ignores Ctrl-C while it waits.
            connection = sqlite3.connect(path, timeout=1.0 if wait else 0.0, isolation_level=None)
        except sqlite3.Error as error:
            raise HomeError(f"{path} cannot be used: {error}") from error
        try:
            locked = _locks(connection, path)
            while wait and not locked:
                locked = _locks(connection, path)
            yield locked
        finally:
            connection.close()

    def _unusable(self, error: OSError) -> HomeError:
        return HomeError(
            f"the client's folder {self.path} cannot be used ({error.strerror}): "
            f"set FRONTRUNNER_HOME to a writable folder"
        )


def _locks(connection: sqlite3.Connection, path: Path) -> bool:
    try:
        connection.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        if error.sqlite_errorcode != sqlite3.SQLITE_BUSY:
            raise HomeError(f"{path} cannot be used: {error}") from error
        return False
    return True


def write_file(path: Path, data: bytes) -> None:
    """Write `data` to `path` atomically: a reader, or a crash, sees the old file or the new one.

    Raises HomeError with the system's reason (a full disk, no permission).
    """
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=".part-")
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        if temporary is not None:
            with suppress(OSError):
                os.unlink(temporary)
        raise HomeError(f"{path} cannot be written: {error.strerror}") from error
