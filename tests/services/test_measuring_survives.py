"""What happens to a real measurement when the one who makes it, the server or the lease is lost."""

import os
import signal
from pathlib import Path
from typing import Any

from tests.services import exploring, notes
from tests.services.client import Client
from tests.services.exploring import BOARD, DEVICE, IMPATIENT
from tests.services.intake import prepare
from tests.services.program import Program, children, family, runs
from tests.services.serving import Serving
from tests.services.worker import Worker
from tests.waiting import PATIENCE_SECONDS, until

REAL = IMPATIENT | {"DJANGO_SETTINGS_MODULE": "crowd.settings"}
OWN = 2  # the key of the test's exploration: a server imports the one that ships first


def measurement(program: Program) -> int | None:
    """The process with which `program` measures, None while there is none."""
    found = [pid for pid, line in children(*family(program.process.pid)).items() if "slam run" in line]
    return found[0] if found else None


def evaluations(server: Serving) -> dict[str, int]:
    """How many evaluations are in each state; empty while the server does not answer."""
    try:
        _, answer = server.call("GET", "/api/v1/explorations")
        counts: dict[str, int] = answer["results"][0]["evaluations"]
    except (OSError, ValueError, KeyError):
        return {}
    return counts


def attempts(var: Path, exploration: int) -> list[tuple[str, int]]:
    """State and attempt of each evaluation of `exploration` (its key) that was begun."""
    rows = exploring.rows(var, REAL, exploration)
    return [(row["state"], row["attempt"]) for row in rows if row["attempt"]]


def finished(rows: list[dict[str, Any]]) -> bool:
    """Whether nothing of it waits or runs any more."""
    return all(row["state"] in {"done", "failed"} for row in rows)


def test_killing_a_worker_ends_its_measurement_which_another_makes_again(tmp_path: Path) -> None:
    var = tmp_path / "var"
    prepare(var, {})
    exploring.start_measured(var, REAL)
    with Worker(var, REAL, BOARD) as worker:
        left = until(lambda: measurement(worker))
        os.kill(worker.process.pid, signal.SIGKILL)
        worker.process.wait()
        until(lambda: not runs(left))

        worker.start()
        until(lambda: ("done", 2) in attempts(var, OWN))

    assert attempts(var, OWN)[0] == ("done", 2)


def test_a_worker_that_is_terminated_gives_back_what_it_measures_at_once(tmp_path: Path) -> None:
    var = tmp_path / "var"
    slow, quick = (exploring.SETTINGS | {"TABLE_SECONDS": seconds} for seconds in ("3600", "0"))
    prepare(var, {})
    key = exploring.start(var, slow, method="random", budget=1, repeats=0)
    with Worker(var, slow, DEVICE, options=("--pool", "solo")) as worker:
        until(lambda: notes.read(var))
        worker.process.send_signal(signal.SIGTERM)
        worker.process.wait(PATIENCE_SECONDS)

    [begun] = [row for row in exploring.rows(var, slow, key) if row["attempt"]]
    assert (begun["state"], begun["attempt"], begun["losses"]) == ("pending", 1, 0)

    with Worker(var, quick, DEVICE, options=("--pool", "solo")):
        until(lambda: finished(exploring.rows(var, quick, key)))
    assert [row["attempt"] for row in exploring.rows(var, quick, key) if row["id"] == begun["id"]] == [2]


def test_a_board_outlives_its_server_and_a_lost_lease(tmp_path: Path) -> None:
    var = tmp_path / "var"
    prepare(var, {})
    with Serving(var, REAL) as server:
        token = exploring.start_measured(var, REAL)
        with Client(tmp_path / "board", server.url, BOARD, token) as client:
            until(lambda: measurement(client))
            server.kill_child("granian")
            until(lambda: evaluations(server).get("done", 0) >= 1)

            frozen = until(lambda: measurement(client))
            for pid in (client.process.pid, frozen):
                os.kill(pid, signal.SIGSTOP)
            until(lambda: evaluations(server).get("running") == 0)
            os.kill(client.process.pid, signal.SIGCONT)
            until(lambda: not runs(frozen))
            until(lambda: ("done", 2) in attempts(var, OWN))
            until(lambda: measurement(client))
            client.process.send_signal(signal.SIGINT)
            client.process.wait(60)
            said = client.said()

        assert "is returned" in said
        assert until(lambda: evaluations(server))["running"] == 0
