"""Explorations over the table beside a server, on the data that it serves."""

import json
from contextlib import closing
from pathlib import Path
from typing import Any

from tests.services.serving import Services, connect, shell

DEVICE, BOARD = "table", "board"
FIELDS = "id", "number", "phase", "configuration", "state", "attempt", "losses", "objectives", "error"
JSON = "configuration", "objectives"
SETTINGS = {"DJANGO_SETTINGS_MODULE": "tests.services.settings"}
# Those of a real installation, except that dead workers are given up within seconds.
IMPATIENT = {
    "FRONTRUNNER_LEASE_SECONDS": "4",
}


def start(var: Path, environment: Services, **wishes: Any) -> int:
    """The key of a new exploration on the data folder `var`, of which the first messages are sent."""
    return int(_beside(var, environment, f"create_and_dispatch({str(var)!r}, {json.dumps(wishes)!r})"))


def start_measured(var: Path, environment: Services) -> str:
    """The token of the device `board`, for which a new exploration by real measurements waits."""
    return _beside(var, environment, "create_measured()").strip()


def start_large(var: Path, environment: Services, measured: int, asked: int) -> int:
    """The key of a new exploration with made-up values of `measured` of the `asked` configurations."""
    return int(_beside(var, environment, f"create_large({str(var)!r}, {measured}, {asked})"))


def rows(var: Path, environment: Services, exploration: int) -> list[dict[str, Any]]:
    """The exploration's evaluations by number, read from the database itself."""
    fields = [f"{name}::text" if name in JSON and "DATABASE_URL" in environment else name for name in FIELDS]
    query = f"SELECT {', '.join(fields)} FROM explorations_evaluation WHERE exploration_id = {exploration}"
    with closing(connect(var, environment)) as database:
        found = database.execute(f"{query} ORDER BY number").fetchall()
    read = [dict(zip(FIELDS, row, strict=True)) for row in found]
    return [row | {name: json.loads(row[name] or "null") for name in JSON} for row in read]


def race(var: Path, environment: Services) -> dict[str, Any]:
    """What tests.services.racing tells of a race on the data folder `var`."""
    report: dict[str, Any] = json.loads(_beside(var, environment, f"run({str(var)!r})", "racing"))
    return report


def _beside(var: Path, environment: Services, call: str, module: str = "explorations") -> str:
    """What `call` of tests.services.MODULE prints in a process with a server's `environment`."""
    code = f"from tests.services import {module}; {module}.{call}"
    return shell(var, code, **SETTINGS | environment)
