"""The commands `run`, `compare`, `evaluate` and `devices`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slam.arguments import UsageError, four_numbers, number, setting, show_progress, three_numbers
from slam.benchmark import FIRST_COUNTED_FRAME, Report, run
from slam.datasets import Sequence, open_sequence
from slam.opencl import choose_device, list_devices
from slam.systems import STAGES, SYSTEMS
from slam.trajectory import (
    MAXIMAL_STAMP_DIFFERENCE,
    Trajectory,
    TrajectoryError,
    absolute_trajectory_error,
    associate,
    relative_pose_error,
)


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands of this module to the command line."""
    parser = subparsers.add_parser("run", help="measure one configuration over a sequence")
    _add_run_options(parser)
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument("--json", metavar="FILE", help="write the report, - for standard output")
    parser.add_argument("--trajectory", type=Path, metavar="FILE", help="write the poses in TUM format")
    parser.set_defaults(execute=_run)

    parser = subparsers.add_parser("compare", help="two reports or two configurations side by side")
    parser.add_argument("first", help='a report (.json) or settings, as in "mu=0.2 compute_size_ratio=2"')
    parser.add_argument("second", help="likewise; an empty text is the default configuration")
    _add_run_options(parser, needs_sequence=False)
    parser.set_defaults(execute=_compare)

    parser = subparsers.add_parser("evaluate", help="the error of an estimated trajectory, as JSON")
    parser.add_argument("--estimate", type=Path, required=True, metavar="FILE")
    parser.add_argument("--truth", type=Path, required=True, metavar="FILE")
    parser.add_argument("--align", choices=("first", "se3", "sim3"), default="first")
    parser.add_argument(
        "--max-difference", type=float, default=MAXIMAL_STAMP_DIFFERENCE, metavar="S", help="between stamps"
    )
    parser.set_defaults(execute=_evaluate)

    parser = subparsers.add_parser("devices", help="the OpenCL devices here, best first")
    parser.set_defaults(execute=_devices)


def _add_run_options(parser: argparse.ArgumentParser, needs_sequence: bool = True) -> None:
    parser.add_argument("--system", choices=sorted(SYSTEMS), default="kfusion")
    parser.add_argument("--sequence", type=Path, required=needs_sequence, metavar="PATH")
    parser.add_argument("--camera", type=four_numbers, metavar="fx,fy,cx,cy", help="for a .raw file")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="a TUM trajectory")
    parser.add_argument("--frames", type=int, metavar="N", help="the first N (default: all)")
    parser.add_argument("--volume-size", type=number, metavar="M", help="default: the sequence's, or 5 m")
    parser.add_argument("--initial-position", type=three_numbers, metavar="x,y,z", help="fractions of it")
    parser.add_argument("--device", metavar="TEXT", help="a part of an OpenCL device's description")


def _open(options: argparse.Namespace) -> Sequence:
    return open_sequence(options.sequence, options.camera, options.truth)


def _measure(options: argparse.Namespace, configuration: Mapping[str, Any]) -> Report:
    return run(
        configuration,
        _open(options),
        system=options.system,
        frames=options.frames,
        device=options.device,
        volume_size=options.volume_size,
        initial_position=options.initial_position,
        progress=show_progress if sys.stderr.isatty() else None,
    )


def _run(options: argparse.Namespace) -> None:
    for path in (options.json, options.trajectory):
        if path and not Path(path).parent.is_dir():
            raise UsageError(f"{path} cannot be written: there is no folder {Path(path).parent}")
    configuration: dict[str, Any] = {}
    for part in options.set:
        configuration |= part
    report = _measure(options, configuration)
    if options.trajectory:
        report.trajectory().write(options.trajectory)
    text = json.dumps(report.to_dict(), indent=1, allow_nan=False) + "\n"
    if options.json == "-":
        sys.stdout.write(text)
        return
    if options.json:
        Path(options.json).write_text(text, encoding="utf-8")
    sys.stdout.write(_summary(report.to_dict()))


def _summary(report: Mapping[str, Any]) -> str:
    sequence, device, frames = report["sequence"], report["device"], report["frames"]
    means = _means(report)
    tracked = [frame["tracked"] for frame in frames]
    lines = [
        f"{report['system']} on {sequence['name']}, {len(frames)} frames of "
        f"{sequence['width']}x{sequence['height']}, {device['name']} ({device['driver']})",
        *(f"{stage:14} {1e3 * means[stage]:8.2f} ms" for stage in (*STAGES, "computation")),
        f"{'CPU':14} {1e3 * report['cpu_seconds'] / len(frames):8.2f} ms a frame, all threads",
        f"tracked {tracked.count(True)}, lost {tracked.count(False)}, not attempted {tracked.count(None)}",
    ]
    if report["peak_memory_bytes"] is not None:
        lines.append(f"peak memory {report['peak_memory_bytes'] / 2**20:.0f} MiB")
    if report["energy_joules"] is not None:
        lines.append(f"energy {report['energy_joules'] / len(frames):.3f} J a frame")
    ate = report["ate"]
    lines.append(
        "trajectory error unknown: the sequence has no truth"
        if ate is None
        else f"trajectory error mean {ate['mean']:.4f} m, max {ate['max']:.4f} m, RMSE {ate['rmse']:.4f} m, "
        f"aligned {ate['rmse_aligned']:.4f} m: {'valid' if report['valid'] else 'not valid'}"
    )
    return "\n".join(lines) + "\n"


def _means(report: Mapping[str, Any]) -> dict[str, float]:
    counted = report["frames"][FIRST_COUNTED_FRAME:] or report["frames"]
    return {key: float(np.mean([frame[key] for frame in counted])) for key in (*STAGES, "computation")}


def _compare(options: argparse.Namespace) -> None:
    first, second = (_report(text, options) for text in (options.first, options.second))
    left, right = _means(first), _means(second)
    lines = [f"{'':14} {'first':>10} {'second':>10} {'ratio':>8}"]
    for stage in (*STAGES, "computation"):
        ratio = f"{left[stage] / right[stage]:8.2f}" if right[stage] else f"{'-':>8}"
        lines.append(f"{stage:14} {1e3 * left[stage]:7.2f} ms {1e3 * right[stage]:7.2f} ms {ratio}")
    for key in ("mean", "max", "rmse"):
        errors = [report["ate"] and f"{report['ate'][key]:.4f} m" for report in (first, second)]
        lines.append(f"{'error ' + key:14} {errors[0] or '-':>10} {errors[1] or '-':>10}")
    lines.append(f"{'valid':14} {_word(first['valid']):>10} {_word(second['valid']):>10}")
    for name in sorted({*first["configuration"], *second["configuration"]}):
        values = [report["configuration"].get(name, "-") for report in (first, second)]
        if values[0] != values[1]:
            lines.append(f"{name}: {values[0]} | {values[1]}")
    if first["sequence"]["sha256"] != second["sequence"]["sha256"]:
        lines.append("beware: the two ran on different sequences")
    if first["device"] != second["device"]:
        lines.append("beware: the two ran on different devices")
    sys.stdout.write("\n".join(lines) + "\n")


def _word(valid: bool | None) -> str:
    return {True: "yes", False: "no", None: "unknown"}[valid]


def _report(text: str, options: argparse.Namespace) -> Mapping[str, Any]:
    """The report in a file, or of a run with the settings in the text."""
    if text.endswith(".json"):
        try:
            report = json.loads(Path(text).read_text(encoding="utf-8"))
            missing = {"frames", "ate", "valid", "configuration", "sequence", "device"} - set(report)
            if missing or not report["frames"]:
                raise ValueError(f"it lacks {', '.join(sorted(missing)) or 'frames'}")
            _means(report)
        except (ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{text} is no report of `python -m slam run --json`: {error}") from None
        return report
    if options.sequence is None:
        raise UsageError(f"{text!r} is no report (.json), so it is run: give --sequence")
    configuration: dict[str, Any] = {}
    try:
        for part in text.split():
            configuration |= setting(part)
    except argparse.ArgumentTypeError as error:
        raise UsageError(str(error)) from None
    return _measure(options, configuration).to_dict()


def _evaluate(options: argparse.Namespace) -> None:
    estimate, truth = Trajectory.read(options.estimate), Trajectory.read(options.truth)
    rows, partners = associate(estimate.timestamps, truth.timestamps, options.max_difference)
    if not len(rows):
        raise TrajectoryError(
            f"no stamps of {options.estimate} ({estimate.timestamps[0]} to {estimate.timestamps[-1]}) and "
            f"{options.truth} ({truth.timestamps[0]} to {truth.timestamps[-1]}) lie within "
            f"{options.max_difference} s: give --max-difference, or trajectories of the same recording"
        )
    poses, true_poses = estimate.poses[rows], truth.poses[partners]
    error = absolute_trajectory_error(poses, true_poses, options.align)
    result: dict[str, Any] = {
        "align": options.align,
        "pairs": len(rows),
        "estimate_poses": len(estimate),
        "truth_poses": len(truth),
        "mean": error.mean,
        "median": float(np.median(error.per_frame)),
        "min": float(error.per_frame.min()),
        "max": error.max,
        "rmse": error.rmse,
        "rmse_aligned": error.rmse_aligned,
    }
    if len(rows) > 1:
        relative = relative_pose_error(poses, true_poses)
        result |= {"rpe_translation": relative.translation, "rpe_rotation_degrees": relative.rotation}
    sys.stdout.write(json.dumps(result, indent=1) + "\n")


def _devices(_: argparse.Namespace) -> None:
    # Without any device, choosing one raises the error that says what to install.
    for device in list_devices() or [choose_device()]:
        sys.stdout.write(
            f"{device.kind:4} {device.label}, {device.compute_units} units, "
            f"{device.global_memory / 2**30:.1f} GiB, one buffer up to {device.max_allocation >> 20} MiB\n"
        )
