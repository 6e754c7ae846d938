"""Notes of measurements, left by the workers that make them for the test that watches."""

from dataclasses import dataclass
from pathlib import Path

FILE = "measured.txt"


@dataclass(frozen=True)
class Note:
    """That the process `pid` began or ended an attempt to measure the evaluation `key`."""

    key: int
    attempt: int
    pid: int
    what: str


def add(var: Path, note: Note) -> None:
    """Note that below the data folder `var`."""
    line = f"{note.key} {note.attempt} {note.pid} {note.what}\n"
    with (var / FILE).open("ab", buffering=0) as file:
        file.write(line.encode())  # at once: lines of several processes never mix


def read(var: Path) -> list[Note]:
    """What was noted below the data folder `var`, in order."""
    path = var / FILE
    rows = (line.split() for line in (path.read_text() if path.exists() else "").splitlines())
    return [Note(int(key), int(attempt), int(pid), what) for key, attempt, pid, what in rows]
