"""`plan`: the steps of a frame, as data."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from slam.cli.arguments import setting, writable
from slam.cli.scenes import Commands, add_scene_options, merged, note_cropping, open_scene
from slam.definitions import complete
from slam.devices.layout import KINDS, Layout
from slam.registry import fit, frame_plan
from slam.system import scene_of


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser("plan", help="write the steps of a frame as JSON")
    add_scene_options(parser)
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument("--layout", choices=KINDS, default="pixels", help="of the kernels; default: pixels")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.set_defaults(execute=_plan)


def _plan(options: argparse.Namespace) -> None:
    writable(options.out)
    configuration = complete(options.system, merged(options.set))
    sequence = fit(options.system, configuration, open_scene(options))
    note_cropping(sequence.camera.width, sequence.camera.height, sequence.cropped_from)
    scene = scene_of(sequence, options.volume_size, options.initial_position)
    plan = frame_plan(options.system, configuration, scene, Layout(options.layout))
    options.out.write_text(plan.to_json(), encoding="utf-8")
    sys.stdout.write(f"{len(plan.dispatches)} dispatches on {len(plan.buffers)} buffers in {options.out}\n")
