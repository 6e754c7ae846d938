"""`reference`: one configuration on all devices here, and how far their trajectories differ."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from groundwork.terminal import progress_line
from slam.cli.arguments import setting, writable
from slam.cli.scenes import Commands, merged
from slam.datasets import open_sequence
from slam.definitions import SYSTEMS, complete
from slam.references import bands


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser(
        "reference",
        help="run a configuration on every device here in every kernel layout, and compare the trajectories",
    )
    parser.add_argument("--system", choices=sorted(SYSTEMS), default="kfusion")
    parser.add_argument("--sequence", type=Path, required=True, metavar="PATH")
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument("--frames", type=int, metavar="N", help="the first N (default: all)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write trajectory, band and deviations")
    parser.set_defaults(execute=_reference)


def _reference(options: argparse.Namespace) -> None:
    writable(options.json)
    configuration = complete(options.system, merged(options.set))
    reference = bands.reference(
        options.system,
        configuration,
        open_sequence(options.sequence),
        options.frames,
        lambda name: progress_line(f"{name}: "),
    )
    for (a, b), metres in reference.deviations.items():
        sys.stdout.write(f"{a} | {b}: {1e3 * metres:.3f} mm\n")
    sys.stdout.write(f"largest deviation {1e3 * reference.largest_deviation:.3f} mm, ")
    sys.stdout.write(f"band {1e3 * reference.band:.3f} mm\n")
    if reference.skipped is not None:
        sys.stdout.write(f"frames left out: {reference.skipped:.0%}\n")
    if options.json:
        document = {
            "report": reference.report.to_dict(),
            "reference": {
                "trajectory": reference.trajectory.tolist(),
                "band": reference.band,
                "largest_deviation": reference.largest_deviation,
                "variants": list(reference.variants),
                "skipped": reference.skipped,
            },
        }
        options.json.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")
