"""python -m tests.benchmarks.sequences: the points of fronts on every synthetic sequence, and on a real one.

Runs the default and the `best` of the two newest fronts of KinectFusion (`--front FILE`: all points of that
one) over the learned-on and the held-out scenes, and over windows of 100 frames and the whole of the real
recording redkitchen where FRONTRUNNER_DATA names it. Each run is a process of its own, by the program as it
is and, in turn, by that of another commit (`--base REV`, by default none). Sequences are made once under
$FRONTRUNNER_VAR. Writes a row for each run to var/benchmarks/sequences.json and prints tables in Markdown.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from slam.datasets import Sequence, open_sequence
from slam.datasets.formats import pack
from slam.datasets.synthetic.prepared import default_folder, make_all
from slam.datasets.synthetic.scenes import with_role

ROOT = Path(__file__).resolve().parents[2]
FRONTS = ROOT / "fixtures" / "fronts"
DATA = Path(os.environ.get("FRONTRUNNER_VAR", ROOT / "var"))
SEQUENCE = ROOT / "fixtures" / "sequences" / "living-room"
WINDOW = 100  # frames
REAL_STARTS = (0, 100, 200)
REAL_VOLUME, REAL_POSITION = 6.0, (0.5, 0.5, 0.1)
# SLAMBench's own OpenMP program over the whole recording with the default's parameters: errors in metres.
# The person who recorded these figures built and ran it, on another machine.
SLAMBENCH = {"redkitchen-0-300": {"ate_mean": 0.048, "ate_max": 0.092}}

Row = dict[str, Any]


class Excerpt(Sequence):
    """`count` frames of `sequence` from frame `start` on, as a sequence of its own."""

    def __init__(self, sequence: Sequence, start: int, count: int) -> None:
        self._sequence, self._start = sequence, start
        frames = slice(start, start + count)
        self.name = f"{sequence.name}-{start}-{count}"
        self.camera = sequence.camera
        self.timestamps = sequence.timestamps[frames]
        self.truth = None if sequence.truth is None else sequence.truth[frames]
        self.volume_size, self.initial_position = REAL_VOLUME, REAL_POSITION

    def depth(self, index: int):
        self.check_index(index)
        return self._sequence.depth(self._start + index)

    @property
    def sha256(self) -> str:
        return hashlib.sha256(f"{self._sequence.sha256} {self._start} {len(self)}".encode()).hexdigest()


def real_excerpts(data: Path) -> Iterator[Excerpt]:
    """Three windows of the real recording below `data`, and all of it."""
    recording = open_sequence(data / "rgbd" / "redkitchen")
    for start in REAL_STARTS:
        yield Excerpt(recording, start, WINDOW)
    yield Excerpt(recording, 0, len(recording))


def packs(folder: Path) -> Iterator[Path]:
    """The packs of the learned-on sequences, of the held-out ones, and of the real one where it is here."""
    yield from make_all([*with_role("learned-on"), *with_role("held-out")], folder)
    data = os.environ.get("FRONTRUNNER_DATA")
    for excerpt in real_excerpts(Path(data)) if data else ():
        path = DATA / "benchmarks" / "sequences" / excerpt.name
        if not (path / pack.MANIFEST).exists():
            pack.write(excerpt, path)
        yield path


def newest_fronts() -> list[Path]:
    """The two newest fronts of KinectFusion that ship, the older one first; the only one, if there is one."""
    return sorted(FRONTS.glob("kfusion-*.json"), key=lambda path: int(path.stem.partition("-")[2]))[-2:]


def points_of(front: Path | None) -> dict[str, dict[str, Any]]:
    """Parameters by name: all points of `front`, or the default and the best of the two newest fronts."""
    if front is not None:
        return {point["name"]: point["parameters"] for point in _read(front)}
    points = {}
    for path in newest_fronts():
        for point in _read(path):
            if point["name"] in ("default", "best"):
                name = "default" if point["name"] == "default" else f"best of {path.stem}"
                points[name] = point["parameters"]
    return points


def _read(front: Path) -> list[dict[str, Any]]:
    return list(json.loads(front.read_text())["configurations"])


def checkout(revision: str) -> Path:
    """A worktree of that commit, made once."""
    commit = subprocess.check_output(["git", "rev-parse", revision], cwd=ROOT, text=True).strip()
    folder = DATA / "benchmarks" / "commits" / commit
    if not folder.exists():
        subprocess.run(["git", "worktree", "add", "--detach", str(folder), commit], cwd=ROOT, check=True)
    return folder


def slam_report(
    parameters: dict[str, Any], *arguments: str, program: Path = ROOT, sequence: Path = SEQUENCE, **more: Any
) -> dict[str, Any]:
    """What a run by the `slam` in the folder `program` reports. `more`: about its process."""
    settings = [f"--set={name}={value}" for name, value in parameters.items()]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "slam", "run", "--sequence", str(sequence), "--json", str(report)]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.run([*command, *arguments, *settings], cwd=program, check=True, **silent, **more)
        return dict(json.loads(report.read_text()))


def run(program: Path, parameters: dict[str, Any], sequence: Path) -> Row:
    """One run by the `slam` in the folder `program`: errors in metres, seconds a frame."""
    content = slam_report(parameters, program=program, sequence=sequence)
    return {
        "device": f"{content['device']['name']} {content['device']['driver']}",
        "ate_max": content["ate"]["max"],
        "ate_mean": content["ate"]["mean"],
        "lost": sum(frame["tracked"] is False for frame in content["frames"]),
        "cpu_seconds": content["cpu_seconds"] / len(content["frames"]),
        "runtime": content["runtime"],
        "runtime_p95": content.get("runtime_p95"),  # earlier commits do not say it
        "skipped": sum(frame.get("skipped", False) for frame in content["frames"]) / len(content["frames"]),
    }


def measure(
    points: dict[str, dict[str, Any]], programs: dict[str, Path], folder: Path, result: Path
) -> list[Row]:
    """Run all and write it to `result`; a row is a configuration on a sequence by a program."""
    rows: list[Row] = []
    result.parent.mkdir(parents=True, exist_ok=True)
    for path in packs(folder):
        for name, parameters in points.items():
            for program, home in programs.items():
                rows.append(
                    {"program": program, "name": name, "sequence": path.name} | run(home, parameters, path)
                )
                result.write_text(json.dumps(rows, indent=1) + "\n")
                sys.stderr.write(f"{path.name} {name}: {100 * rows[-1]['ate_max']:.2f} cm\n")
    return rows


def table(rows: list[Row], cell: Callable[[Row], str], recorded: bool = False) -> str:
    """Markdown: a line for each configuration and program, a column for each sequence."""
    columns = list(dict.fromkeys(row["sequence"] for row in rows))
    lines = ["| | | " + " | ".join(columns) + " |", "|---" * (len(columns) + 2) + "|"]
    texts = {(row["name"], row["program"], row["sequence"]): cell(row) for row in rows}
    for name, program in dict.fromkeys((row["name"], row["program"]) for row in rows):
        cells = [texts.get((name, program, column), "not run") for column in columns]
        lines.append(f"| {name} | {program} | " + " | ".join(cells) + " |")
    if recorded and SLAMBENCH.keys() & set(columns):
        cells = [f"{100 * SLAMBENCH[name]['ate_max']:.2f}" if name in SLAMBENCH else "" for name in columns]
        lines.append("| default | SLAMBench, recorded | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def error_cell(row: Row) -> str:
    """The largest error in cm, and the number of lost frames where there are any."""
    return f"{100 * row['ate_max']:.2f}" + (f" ({row['lost']})" if row["lost"] else "")


def report(
    front: Path | None = None, base: str | None = None, only: str | None = None, folder: Path | None = None
) -> list[Row]:
    """Measure and print; the rows."""
    points = points_of(front)
    if only:
        points = {name: points[name] for name in ("default", *only.split(",")) if name in points}
    programs = {"now": ROOT} if base is None else {base: checkout(base), "now": ROOT}
    name = f"sequences-{front.stem}.json" if front else "sequences.json"
    rows = measure(points, programs, folder or default_folder(), DATA / "benchmarks" / name)
    sys.stdout.write("Largest error, cm (lost frames):\n\n" + table(rows, error_cell, recorded=True))
    cpu = table(rows, lambda row: f"{1e3 * row['cpu_seconds']:.1f}")
    sys.stdout.write("\nCPU time, ms a frame:\n\n" + cpu)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--front", type=Path, metavar="FILE", help="all points of it")
    parser.add_argument("--base", metavar="REV", help="a commit whose program runs in turn with this one")
    parser.add_argument("--only", metavar="A,B", help="names of configurations; default comes first")
    parser.add_argument("--sequences", type=Path, metavar="DIR", default=default_folder())
    options = parser.parse_args()
    report(options.front, options.base, options.only, options.sequences)


if __name__ == "__main__":
    main()
