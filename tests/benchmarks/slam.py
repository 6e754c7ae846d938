"""KinectFusion on every OpenCL device here and by WebAssembly, in wasmtime and in a browser's engine, beside
Open3D's dense SLAM, over the shipped sequence. Then every backend against the reference trajectories, and
ElasticFusion over the same frames, with where its time goes. Then CPU time before a commit and now, its bound
and a profile (`speed`). Last the default and the best of the newest fronts on every sequence, by the commit
before and by this one.

    python -m tests.benchmarks.slam [--frames N] [--sequence PATH] [--base REV]

Every row is a process of its own. CPU time sums all threads: on a shared machine it is steadier than wall
time. The last column divides it by that of the first OpenCL device in this run. The aims are the project's
for a 2-core machine with AVX-512, on a distribution's PoCL and on PoCL's wheel; the reference is SLAMBench's
C++ KinectFusion on one thread of such a machine. Open3D goes into an environment of its own under the data
folder; where it cannot be installed, its row says so.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.datasets import Sequence, open_sequence
from slam.kfusion.configuration import ANDROID_APP, DEFAULT, STANDARD, Configuration
from slam.trajectories.trajectory import absolute_trajectory_error
from tests.benchmarks import conformance, elasticfusion, sequences, speed
from tests.benchmarks.sequences import DATA, SEQUENCE
from tests.client_kit.web import deno

OPEN3D = "open3d-cpu==0.20.0"

SMALLEST = Configuration(
    compute_size_ratio=8,
    volume_resolution=64,
    pyramid_iterations_fine=4,
    pyramid_iterations_middle=3,
    pyramid_iterations_coarse=0,
)
# Name, configuration, CPU-ms of the reference, aims on a distribution's PoCL and on PoCL's wheel.
ROWS = [
    ("default", DEFAULT, 388.0, (70, 175)),
    ("STANDARD", STANDARD, 126.0, (30, 75)),
    ("FAST1", ANDROID_APP["FAST1"], 11.1, (3, 8)),
    ("64^3, ratio 8", SMALLEST, 3.2, (2, 4)),
]


THREADS = (1, 2)  # of WebAssembly
COMPILED = 10  # the first frame that V8 has compiled everything for

LIST_DEVICES = """
import json
from slam.devices.choice import list_devices
print(json.dumps([[device.driver, device.kind] for device in list_devices()]))
"""


def devices() -> list[tuple[str, str]]:
    """Driver and kind of every device present, asked in a process of its own."""
    listed = subprocess.run([sys.executable, "-c", LIST_DEVICES], check=True, capture_output=True)
    return [(driver, kind) for driver, kind in json.loads(listed.stdout)]


def kfusion(
    sequence: Path, configuration: Configuration, frames: int, driver: str = "", threads: int | None = None
) -> dict[str, Any]:
    """One run on the OpenCL device of `driver`, or by WebAssembly on as many processors as `threads`.

    CPU and wall milliseconds a frame, errors in metres.
    """
    chosen = ["--backend", "wasm"] if threads else ["--device", driver]
    processors = sorted(os.sched_getaffinity(0))[:threads]
    content = sequences.slam_report(
        configuration.to_dict(),
        *("--system", "kfusion", "--frames", str(frames), *chosen),
        sequence=sequence,
        preexec_fn=lambda: os.sched_setaffinity(0, processors),
    )
    return {
        "device": content["device"],
        "cpu_ms": 1e3 * content["cpu_seconds"] / len(content["frames"]),
        "wall_ms": 1e3 * content["runtime"],
        "ate": content["ate"],
    }


def errors_of(poses: NDArray[np.float64], truth: NDArray[np.float64] | None) -> dict[str, float] | None:
    """Errors of trajectories in metres, None where the sequence has no truth."""
    if truth is None:
        return None
    error = absolute_trajectory_error(poses, truth[: len(poses)])
    return {"mean": error.mean, "max": error.max, "rmse_aligned": error.rmse_aligned}


def v8(sequence: Path, configuration: Configuration, frames: int, threads: int) -> dict[str, Any]:
    """The same by the browser's modules in Deno, from frame COMPILED on: before, V8 still compiles."""
    done = deno.execute(configuration.to_dict(), sequence, "wasm", frames, COMPILED, threads)
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, :3, 3] = done.positions
    counted = len(done.seconds)
    return {
        "device": {"name": "V8"},
        "cpu_ms": 1e3 * (done.cpu or 0.0) / counted,
        "wall_ms": 1e3 * sum(done.seconds) / counted,
        "ate": errors_of(poses, open_sequence(sequence).truth),
    }


def open3d_python() -> Path | str:
    """The interpreter of an environment with Open3D, made on first use; or why there is none."""
    folder = DATA / "benchmarks" / "open3d"
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
    install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", OPEN3D]
    for command in (install, [str(python), "-c", "import open3d"]):
        ended = subprocess.run(command, capture_output=True, text=True)
        if ended.returncode:
            return (ended.stderr.strip().splitlines() or ["no reason given"])[-1]
    return python


def open3d(sequence: Sequence, frames: int) -> dict[str, Any] | str:
    """Open3D over the same frames, or why it was not measured."""
    python = open3d_python()
    if isinstance(python, str):
        return python
    camera = sequence.camera
    with tempfile.TemporaryDirectory() as folder:
        given = Path(folder) / "sequence.npz"
        np.savez(
            given,
            depth=np.stack([sequence.depth(index) for index in range(frames)]),
            intrinsics=np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
            volume_size=sequence.volume_size or 5.0,
        )
        peer = Path(__file__).parent / "peers" / "open3d_slam.py"
        # Without this its threads spin while they wait, which would inflate its CPU time.
        environment = os.environ | {"OMP_WAIT_POLICY": "passive"}
        ended = subprocess.run(
            [str(python), str(peer), str(given)], capture_output=True, text=True, env=environment
        )
    if ended.returncode:
        return (ended.stderr.strip().splitlines() or ["no reason given"])[-1]
    result = json.loads(ended.stdout[ended.stdout.index("{") :])
    return result | {"ate": errors_of(np.array(result.pop("poses")), sequence.truth)}


def line(
    name: str, device: str, result: dict[str, Any], aims: str, reference: str, ratio: str, opencl: str
) -> str:
    """One row of the table."""
    ate = result["ate"] or {"mean": float("nan"), "max": float("nan")}
    return (
        f"{name:<15}{device:<34}{result['cpu_ms']:>8.1f}{result['wall_ms']:>8.1f}{aims:>10}{reference:>11}"
        f"{1e3 * ate['mean']:>10.2f}{1e3 * ate['max']:>8.2f}{ratio:>10}{opencl:>10}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="KinectFusion beside Open3D on the same sequence.")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--sequence", type=Path, default=SEQUENCE)
    parser.add_argument("--base", metavar="REV", default="HEAD", help="the commit before (HEAD)")
    arguments = parser.parse_args()
    sequence = open_sequence(arguments.sequence)
    frames = min(arguments.frames, len(sequence))

    present = devices()
    peer = open3d(sequence, frames)
    measured: list[dict[str, Any]] = []
    for name, configuration, reference, aims in ROWS:
        for driver, kind in present:
            row = {"name": name, "driver": driver, "kind": kind, "reference": reference, "aims": aims}
            measured.append(row | kfusion(arguments.sequence, configuration, frames, driver))
        for threads in THREADS:
            row = {
                "name": name,
                "driver": "wasmtime",
                "kind": "cpu",
                "reference": reference,
                "threads": threads,
            }
            measured.append(row | kfusion(arguments.sequence, configuration, frames, threads=threads))
            measured.append(row | {"driver": "V8"} | v8(arguments.sequence, configuration, frames, threads))

    print(f"{sequence.name}, {frames} frames; milliseconds a frame, errors in millimetres")
    print(
        f"{'configuration':<15}{'device':<34}{'CPU':>8}{'wall':>8}{'aims':>10}{'reference':>11}"
        f"{'ATE mean':>10}{'max':>8}{'x Open3D':>10}{'/ OpenCL':>10}"
    )
    first = {row["name"]: row["cpu_ms"] for row in reversed(measured) if "threads" not in row}
    for row in measured:
        ratio = f"{peer['cpu_ms'] / row['cpu_ms']:.1f}x" if isinstance(peer, dict) else "-"
        aims = "/".join(str(aim) for aim in row.get("aims", ()))
        device = f"{row['device']['name'][:20]} {row['driver']}"
        if "threads" in row:
            device = f"{row['driver']}, threads: {row['threads']}"
        opencl = f"{row['cpu_ms'] / first[row['name']]:.2f}" if first else "-"
        print(line(row["name"], device, row, aims, f"{row['reference']:.1f}", ratio, opencl))
    if isinstance(peer, dict):
        print(line("Open3D t.slam", f"Open3D {peer['version']}", peer, "", "", "1.0x", ""))
    else:
        print(f"Open3D t.slam  not measured: {peer}")
    if "gpu" not in {kind for _, kind in present}:
        print("GPU            not measured: no OpenCL GPU here")
    print("\nEvery backend against the reference trajectories")
    conforming = conformance.measure(arguments.sequence) if frames == len(sequence) else []
    elastic = [elasticfusion.measure(arguments.sequence, driver, frames) for driver, _ in present]
    faster = speed.report(arguments.base, frames)
    print("\nThe newest fronts on every sequence")
    by_sequence = sequences.report(base=arguments.base)
    target = DATA / "benchmarks" / "slam.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    content = {
        "frames": frames,
        "kfusion": measured,
        "conformance": conforming,
        "open3d": peer,
        "elasticfusion": elastic,
        "speed": faster,
        "sequences": by_sequence,
    }
    target.write_text(json.dumps(content, indent=1))
    print(f"written to {target}")


if __name__ == "__main__":
    main()
