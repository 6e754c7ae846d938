"""Other optimisers on the same problems: an environment of their own, and runs that are kept.

A run of a peer depends on nothing of this project's methods, so its evaluations are stored by problem,
program, versions and seed, and not repeated.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import tempfile
import venv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.pareto_problems import ROOT, Problem

DATA = Path(os.environ.get("FRONTRUNNER_VAR", ROOT / "var")) / "benchmarks"
ENVIRONMENT = DATA / "pareto-peers"
RUNS = DATA / "pareto"
PROGRAMS = Path(__file__).parent / "peers"


@dataclass(frozen=True)
class Peer:
    """A program in peers/, the method it is asked for, the packages it needs, and its largest budget."""

    name: str
    program: str
    method: str
    packages: tuple[str, ...]
    most: int = 1000  # evaluations; fewer for those that take seconds for each


PEERS = (
    Peer("Optuna NSGA-II", "optuna_search.py", "nsga2", ("optuna",)),
    Peer("Optuna TPE", "optuna_search.py", "tpe", ("optuna",)),
    Peer("pymoo NSGA-II", "pymoo_search.py", "nsga2", ("pymoo",)),
    Peer("SMAC ParEGO", "smac_search.py", "parego", ("smac",), most=200),
    Peer("Optuna GP", "optuna_search.py", "gp", ("optuna", "torch"), most=200),
    Peer("HyperMapper", "hypermapper_search.py", "random forest", ("setuptools", "hypermapper"), most=200),
)


def pins() -> dict[str, str]:
    """What is installed of each package, by name: `name==version`."""
    lines = (PROGRAMS / "requirements.txt").read_text(encoding="utf-8").splitlines()
    wanted = [line.split("#")[0].strip() for line in lines]
    return {pin.split("==")[0]: pin for pin in wanted if pin}


def python() -> Path:
    """The interpreter of the peers' environment, which is made on first use."""
    interpreter = ENVIRONMENT / "bin" / "python"
    if not interpreter.exists():
        venv.create(ENVIRONMENT, with_pip=True)
    return interpreter


def missing(packages: tuple[str, ...]) -> str | None:
    """Install what is not there yet; return why one of `packages` cannot be had, None if all are."""
    check = "import importlib.metadata as m, sys; sys.exit(m.version(sys.argv[1]) != sys.argv[2])"
    for package in packages:
        pin = pins()[package]
        present = subprocess.run(
            [python(), "-c", check, package, pin.partition("==")[2]], capture_output=True
        )
        if present.returncode == 0:
            continue
        command = [python(), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", pin]
        ended = subprocess.run(
            [*command, "--constraint", PROGRAMS / "requirements.txt"], capture_output=True, text=True
        )
        if ended.returncode:
            return f"{pin} cannot be installed: {last_line(ended.stderr)}"
    return None


def last_line(text: str) -> str:
    """The line in which a program says why it failed."""
    return (text.strip().splitlines() or ["no reason given"])[-1]


def stored(problem: Problem, peer: Peer, seed: int) -> Path:
    """Where a run is kept: another program, pin, budget or problem is another file."""
    described = [
        (PROGRAMS / peer.program).read_text(encoding="utf-8"),
        [pins()[package] for package in peer.packages],
        problem.digest,
        peer.method,
        budget_of(problem, peer.name),
    ]
    digest = hashlib.sha256(json.dumps(described).encode()).hexdigest()[:12]
    name = f"{problem.name} {peer.name} {seed} {digest}.json".replace(",", "").replace(" ", "-")
    return RUNS / name


def saved(array: NDArray[Any]) -> Path:
    """An .npy file of `array`, written once."""
    target = RUNS / f"{hashlib.sha256(array.tobytes()).hexdigest()[:16]}.npy"
    if not target.exists():
        with tempfile.NamedTemporaryFile(dir=RUNS, suffix=".npy", delete=False) as file:
            np.save(file, array)
        os.replace(file.name, target)
    return target


def budget_of(problem: Problem, name: str) -> int:
    """The largest number of evaluations that the method or peer of that name is run for."""
    most = next((peer.most for peer in PEERS if peer.name == name), problem.marks[-1])
    return max(mark for mark in problem.marks if mark <= most)


def forget() -> None:
    """Drop every stored run."""
    for path in RUNS.glob("*.json"):
        path.unlink()


def run(problem: Problem, peer: Peer, seed: int) -> dict[str, Any]:
    """One run, from the store if it is there.

    `indices` evaluated in order, CPU `seconds`, `versions`; or only `failed`, with the reason.
    """
    target = stored(problem, peer, seed)
    if target.exists():
        return json.loads(target.read_text(encoding="utf-8"))
    RUNS.mkdir(parents=True, exist_ok=True)
    values = saved(problem.values)
    allowed = saved(problem.space.allowed_grid) if problem.space.constraints else None
    factors = problem.factors(seed)
    request = {
        "space": problem.space.to_dict(),
        "values": str(values),
        "allowed": allowed and str(allowed),
        "factors": None if factors is None else str(saved(factors)),
        "limits": problem.limits,
        "budget": budget_of(problem, peer.name),
        "seed": seed,
        "method": peer.method,
    }
    # One thread: CPU seconds then mean the same for all, and seeds run beside each other.
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "request.json"
        path.write_text(json.dumps(request), encoding="utf-8")
        ended = subprocess.run(
            [python(), PROGRAMS / peer.program, path],
            capture_output=True,
            text=True,
            env=os.environ | threads,
        )
    if ended.returncode:
        return {"failed": last_line(ended.stderr)}
    result = json.loads(last_line(ended.stdout))
    written = target.with_suffix(".part")
    written.write_text(json.dumps(result), encoding="utf-8")
    os.replace(written, target)
    return result
