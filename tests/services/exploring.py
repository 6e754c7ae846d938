"""Explorations over the table beside a server, on the data that it serves."""

import json
from pathlib import Path
from typing import Any

from tests.services.serving import Services, command

DEVICE, BOARD = "table", "board"
SETTINGS = {"DJANGO_SETTINGS_MODULE": "tests.services.settings"}
# Those of a real installation, but for dead workers being given up within seconds.
IMPATIENT = {
    "FRONTRUNNER_LEASE_SECONDS": "4",
    "FRONTRUNNER_HEARTBEAT_SECONDS": "1",
    "FRONTRUNNER_REAP_SECONDS": "1",
}


def start(var: Path, environment: Services, **wishes: Any) -> int:
    """The key of a new exploration on the data folder VAR, of which the first messages are sent."""
    return int(_beside(var, environment, f"create_and_dispatch({str(var)!r}, {json.dumps(wishes)!r})"))


def start_measured(var: Path, environment: Services) -> str:
    """The token of the device `board`, for which a new exploration by real measurements waits."""
    return _beside(var, environment, "create_measured()").strip()


def start_large(var: Path, environment: Services, measured: int, asked: int) -> int:
    """The key of a new exploration with made-up values of MEASURED of the ASKED configurations."""
    return int(_beside(var, environment, f"create_large({str(var)!r}, {measured}, {asked})"))


def rows(var: Path, environment: Services, exploration: int) -> list[dict[str, Any]]:
    """The exploration's evaluations by number."""
    found: list[dict[str, Any]] = json.loads(_beside(var, environment, f"print_rows({exploration})"))
    return found


def race(var: Path, environment: Services) -> dict[str, Any]:
    """What tests.services.racing tells of a race on the data folder VAR."""
    told: dict[str, Any] = json.loads(_beside(var, environment, f"run({str(var)!r})", "racing"))
    return told


def _beside(var: Path, environment: Services, call: str, module: str = "explorations") -> str:
    """What CALL of tests.services.MODULE prints in a process with a server's ENVIRONMENT."""
    code = f"from tests.services import {module}; {module}.{call}"
    done = command(var, "shell", "--no-imports", "-c", code, **SETTINGS | environment)
    assert done.returncode == 0, done.stderr
    return done.stdout
