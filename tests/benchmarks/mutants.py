"""What the tests protect: the share of small changes of the product (mutants) that make a test fail.

    python -m tests.benchmarks.mutants record     once: which quick test runs which line
    python -m tests.benchmarks.mutants kill       150 mutants chosen by a seed; the tests of each line

It needs `cosmic-ray` and `pytest-cov` beside what `make test` installs. A mutant is run in a copy of the
checkout and in a process of its own, since OpenCL does not survive a fork.
"""

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("crowd/results", "crowd/fronts", "pareto/search", "slam/plans", "client_kit/delivery")
QUICK = "not slow and not exhaustive"
MOST_TESTS = 200  # of one line: those of the module's own folder first
SECONDS = 300  # a mutant that runs longer is killed: it never ends


class Mutant(NamedTuple):
    """The `occurrence`-th place in `path` where `operator` changes something, which is in `line`."""

    path: str
    line: int
    operator: str
    occurrence: int


def places(path: Path) -> Iterator[Mutant]:
    """Every mutant of a module."""
    from cosmic_ray.ast import ast_nodes, get_ast_from_path
    from cosmic_ray.plugins import get_operator, operator_names

    tree = get_ast_from_path(path)
    for name in sorted(operator_names()):
        # Of `|` most are types; the last two change a name to any other.
        if "BitOr" in name or name.endswith(("VariableReplacer", "VariableInserter")):
            continue
        operator = get_operator(name)()
        found = (position for node in ast_nodes(tree) for position in operator.mutation_positions(node))
        for occurrence, ((line, _), _) in enumerate(found):
            yield Mutant(str(path.relative_to(ROOT)), line, name, occurrence)


def choose(count: int, seed: int) -> list[Mutant]:
    """`count` mutants: as many of each folder, each in a line of its own."""
    chance = random.Random(seed)
    chosen = []
    for folder in FOLDERS:
        modules = [path for path in sorted((ROOT / folder).rglob("*.py")) if "migrations" not in path.parts]
        lines: dict[tuple[str, int], list[Mutant]] = {}
        for mutant in (one for path in modules for one in places(path)):
            lines.setdefault(mutant[:2], []).append(mutant)
        chosen += [chance.choice(lines[line]) for line in chance.sample(sorted(lines), count // len(FOLDERS))]
    return chosen


def record(contexts: Path) -> None:
    """Run the quick tests and store in `contexts` which of them runs which line."""
    measured = [f"--cov={folder}" for folder in FOLDERS]
    command = ["-m", "pytest", "-q", "-n", "2", "-m", QUICK, "--cov-context=test", "--cov-report=", *measured]
    subprocess.run(
        [sys.executable, *command], cwd=ROOT, env=os.environ | {"COVERAGE_FILE": str(contexts)}, check=False
    )


def tests_of(mutant: Mutant, contexts: Path) -> list[str]:
    """The tests that run its line, those of the folder with the module's own name first.

    No test runs a line that an import runs: then those that run any line of the module.
    """
    from coverage import CoverageData

    data = CoverageData(str(contexts))
    data.read()
    by_line = data.contexts_by_lineno(str(ROOT / mutant.path))
    found = {context for context in by_line.get(mutant.line, []) if context}
    found = found or {context for contexts in by_line.values() for context in contexts if context}
    tests = sorted({context.partition("|")[0] for context in found})
    own = Path(mutant.path).parent.name
    return sorted(tests, key=lambda test: own not in Path(test.partition("::")[0]).parts)[:MOST_TESTS]


def is_killed(mutant: Mutant, tests: list[str], copy: Path) -> bool:
    """Whether one of `tests` fails in `copy`, a copy of the checkout, once it is mutated."""
    from cosmic_ray.mutating import MutationVisitor
    from cosmic_ray.plugins import get_operator

    MutationVisitor.mutate_path(copy / mutant.path, get_operator(mutant.operator)(), mutant.occurrence)
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests],
            cwd=copy,
            env=os.environ | {"PYTHONDONTWRITEBYTECODE": ""},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    finally:
        shutil.copy2(ROOT / mutant.path, copy / mutant.path)
    return ended.returncode != 0


def kill(contexts: Path, count: int, seed: int) -> None:
    """Print a line for each mutant, as JSON, and the share killed."""
    killed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        subprocess.run(["git", "clone", "--quiet", ROOT, copy], check=True)
        for mutant in (chosen := choose(count, seed)):
            tests = tests_of(mutant, contexts)
            died = bool(tests) and is_killed(mutant, tests, copy)
            killed += died
            print(json.dumps({**mutant._asdict(), "tests": len(tests), "killed": died}), flush=True)
    print(f"killed {killed} of {len(chosen)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("step", choices=["record", "kill"])
    parser.add_argument("--contexts", type=Path, default=ROOT / "var" / "mutants.coverage")
    parser.add_argument("--count", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.step == "record":
        record(asked.contexts.resolve())
    else:
        kill(asked.contexts.resolve(), asked.count, asked.seed)


if __name__ == "__main__":
    main()
