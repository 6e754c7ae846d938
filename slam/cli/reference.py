"""`reference`: the trajectories, bands and times that protocol 2 adds to a front."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from frontrunner.terminal import progress_line
from slam.cli.arguments import UsageError, writable
from slam.cli.scenes import Commands
from slam.datasets import open_sequence
from slam.protocol import fixed_pairs
from slam.references import bands, times


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser(
        "reference",
        help="convert a front to protocol 2: a trajectory and a band for each configuration and probe, from "
        "all devices here",
    )
    parser.add_argument("--front", type=Path, required=True, metavar="FILE", help="JSON with configurations")
    parser.add_argument("--sequence", type=Path, required=True, metavar="PATH")
    parser.add_argument("--frames", type=int, metavar="N", help="the first N (default: the front's protocol)")
    parser.add_argument(
        "--rounds",
        type=int,
        default=times.ROUNDS,
        metavar="N",
        help="in which each is timed relative to the default; 0: none (default: %(default)s)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.set_defaults(execute=_reference)


def _reference(options: argparse.Namespace) -> None:
    writable(options.out)
    front = bands.read_front(options.front)
    sequence = open_sequence(options.sequence)
    frames = options.frames or front.get("protocol", {}).get("frames") or len(sequence)
    if not 1 <= frames <= len(sequence):
        raise UsageError(f"--frames {frames}: give 1 to {len(sequence)}, the frames of {sequence.name!r}")
    probes = front.pop("probes", [])
    kept: list[dict[str, Any]] = []
    every = [(point, False) for point in front["configurations"]] + [(probe, True) for probe in probes]
    for configuration, is_probe in every:
        name = configuration["name"]
        found = bands.reference(configuration["parameters"], sequence, frames, progress_line(f"{name}: "))
        configuration |= {"band": found.band, "trajectory": found.trajectory.tolist()}
        unsteady = is_probe and found.band > bands.WIDEST_BAND_OF_A_PROBE
        if is_probe and not unsteady:
            kept.append(configuration)
        largest, band = 1e2 * max(found.deviations.values()), 1e2 * found.band
        note = ": left out, because the devices here do not agree" if unsteady else ""
        sys.stdout.write(f"{name}: largest deviation {largest:.3f} cm, band {band:.3f} cm{note}\n")
    if kept:
        front["probes"] = kept
    if "protocol" in front:
        front["protocol"] = fixed_pairs(front["protocol"])
    if options.rounds > 0:
        device = _add_times([*front["configurations"], *kept], options.sequence, frames, options.rounds)
        said = f"{options.rounds} rounds beside the default on {device}"
        front["provenance"] = front.get("provenance", {}) | {"on_sequence": said}
    options.out.write_text(bands.front_text(front), encoding="utf-8")


def _add_times(points: list[dict[str, Any]], sequence: Path, frames: int, rounds: int) -> str:
    """Add to each of POINTS its times on SEQUENCE relative to the default; return the device."""
    parameters = {point["name"]: point["parameters"] for point in points}
    if times.DEFAULT not in parameters:
        raise UsageError(
            "--front: no configuration is called default, so there is no baseline for times: give --rounds 0"
        )
    progress = progress_line("times: ", "run")
    measured, device = times.on_sequence(parameters, sequence, frames, rounds, progress)
    for point in points:
        point.setdefault("predicted", {})["on_sequence"] = measured[point["name"]]
    return device
