"""A search whose workers, in folders of their own, and the search itself are killed in turn."""

import csv
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from tests.services.program import free_port
from tests.waiting import until

pytestmark = pytest.mark.slow

SPACE = """{"name": "two", "parameters": [
    {"name": "a", "type": "integer", "minimum": 0, "maximum": 40},
    {"name": "b", "type": "integer", "minimum": 0, "maximum": 9}]}"""
PROGRAM = """
import json, os, sys, time
point = json.loads(sys.argv[1])
with open(os.environ["BEGUN"], "a") as file:
    file.write(f"{point['a']} {point['b']}\\n")
time.sleep(1)
print(json.dumps({"cost": point["a"] - 10 * point["b"], "rate/s": -1.5}))
"""
# What breaks the limit of 15 takes an hour, unless it ends early.
REPORTS = """
import json, sys, time
point = json.loads(sys.argv[1])
cost = point["a"] + point["b"]
print(f"report cost={cost / 2} rate/s~{point['b']}", flush=True)
time.sleep(3600 if cost / 2 > 15 else 0)
print(json.dumps({"cost": cost, "rate/s": point["b"]}))
"""
BUDGET, LEASE_SECONDS = 14, 8


class Hosts:
    """A search in a folder, and workers in others; any of them may be killed and started again."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, free_port()
        (folder / "space.json").write_text(SPACE)
        (folder / "program.py").write_text(PROGRAM)
        self.command = f"{sys.executable} {folder / 'program.py'} {{config}}"
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def search(self, *more: str, served: bool = True, out: str = "out") -> None:
        space = ["--space", "space.json", "--objectives", "cost,rate/s", "--method", "random"]
        plan = ["--budget", str(BUDGET), "--out", out, "--no-picture", "--jobs", "4"]
        source = ["--command", self.command, *(["--serve-workers", str(self.port)] if served else [])]
        self._start("search", "tune", "explore", *space, *plan, *source, *more)

    def worker(self, name: str, command: str | None = None) -> None:
        token = self.folder / "out" / "workers" / "token"
        until(token.exists)
        url = f"http://127.0.0.1:{self.port}"
        options = ["--token-file", str(token), "--command", command or self.command, "--folder", name]
        self._start(name, "worker", url, *options)

    def kill(self, name: str) -> None:
        process = self.running.pop(name)
        process.send_signal(signal.SIGKILL)
        process.wait()

    def begun(self) -> list[str]:
        path = self.folder / "begun"
        return path.read_text().splitlines() if path.exists() else []

    def rows(self, out: str = "out") -> list[dict[str, str]]:
        path = self.folder / out / "evaluations.csv"
        if not path.exists():
            return []
        with path.open(newline="") as file:
            return list(csv.DictReader(file))

    def _start(self, name: str, *words: str) -> None:
        environment = {
            **os.environ,
            "BEGUN": str(self.folder / "begun"),
            "FRONTRUNNER_LEASE_SECONDS": str(LEASE_SECONDS),
            "PYTHONPATH": str(Path(__file__).parents[2]),
        }
        with (self.folder / f"{name}.log").open("ab") as log:
            self.running[name] = subprocess.Popen(
                [sys.executable, "-m", "frontrunner", *words],
                cwd=self.folder,
                env=environment,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )


@pytest.fixture
def hosts(tmp_path: Path):
    hosts = Hosts(tmp_path)
    yield hosts
    for name in list(hosts.running):
        hosts.kill(name)


def test_nothing_is_lost_or_counted_twice_when_each_is_killed_in_turn(hosts: Hosts) -> None:
    hosts.search()
    for name in ("one", "two"):
        hosts.worker(name)
    for name in ("one", "two"):  # in the middle of a measurement
        before = len(hosts.begun())
        until(lambda before=before: len(hosts.begun()) > before)
        hosts.kill(name)
        hosts.worker(name)
    done = len(hosts.rows())
    until(lambda: len(hosts.rows()) > done)
    hosts.kill("search")
    killed = time.monotonic()
    # Meanwhile leases run out, and workers finish what they measure and keep the results.
    until(lambda: time.monotonic() > killed + LEASE_SECONDS + 1)
    hosts.search()
    until(lambda: hosts.running["search"].poll() is not None)
    assert hosts.running["search"].returncode == 0
    rows = hosts.rows()
    assert [row["number"] for row in rows] == [str(number) for number in range(1, BUDGET + 1)]
    assert len({(row["a"], row["b"]) for row in rows}) == BUDGET
    for row in rows:
        assert float(row["cost"]) == int(row["a"]) - 10 * int(row["b"])
        assert row["rate/s"] == "-1.5"
    # Only what a killed worker had begun was measured again.
    repeated = sum(times - 1 for times in Counter(hosts.begun()).values())
    assert repeated <= 2
    assert len(hosts.begun()) - repeated == BUDGET


def test_a_worker_with_another_command_is_refused(hosts: Hosts) -> None:
    hosts.search()
    hosts.worker("stranger", command=f"{hosts.command} --faster")
    until(lambda: hosts.running["stranger"].poll() is not None)
    assert hosts.running["stranger"].returncode == 2
    assert "--command differs from that of the search" in (hosts.folder / "stranger.log").read_text()
    assert hosts.begun() == []
    hosts.worker("known")
    until(lambda: len(hosts.rows()) == BUDGET)


def test_bad_runs_end_early_on_other_hosts_as_on_this_one(hosts: Hosts) -> None:
    (hosts.folder / "program.py").write_text(REPORTS)
    limits = ["--limits", "cost=15", "--grace", "0.2"]
    hosts.search(*limits)
    for name in ("one", "two"):
        hosts.worker(name)
    until(lambda: hosts.running["search"].poll() is not None)
    hosts.search(*limits, served=False, out="local")
    until(lambda: hosts.running["search"].poll() is not None)
    marks, local = (
        {(row["a"], row["b"], row["cost"], row["rate/s"], row["censored"]) for row in hosts.rows(out)}
        for out in ("out", "local")
    )
    assert marks == local
    assert len(marks) == BUDGET
    assert {mark for *_, mark in marks} == {"", "cost"}
    ended = [(hosts.folder / f"{name}.log").read_text().count("ended early") for name in ("one", "two")]
    assert sum(ended) == sum(bool(mark) for *_, mark in marks)
