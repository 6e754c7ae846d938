"""The commands `datasets make`, `convert`, `list`, `info` and `get`."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from groundwork import terminal
from groundwork.folders import SEQUENCES
from groundwork.terminal import progress_line
from slam.cli.arguments import UsageError, number, three_numbers
from slam.cli.scenes import Commands, add_source_options, open_source
from slam.datasets import Sequence, SequenceError
from slam.datasets.altered import Altered, Dropped
from slam.datasets.conversion import FORMATS, check_target, form_of, write
from slam.datasets.formats import pack
from slam.datasets.formats.pack import Pack
from slam.datasets.plausibility import sample_depth
from slam.datasets.public import retrieval
from slam.datasets.sequence import LARGEST_VOLUME
from slam.datasets.synthetic.camera_paths import SEED
from slam.datasets.synthetic.motions import MOTIONS, with_motion
from slam.datasets.synthetic.prepared import default_folder, make_all
from slam.datasets.synthetic.rendering import CAMERA, SyntheticSequence
from slam.datasets.synthetic.scenes import SCENES, SyntheticScene, with_role

ALL = "all"


def add(subparsers: Commands) -> None:
    """Add `datasets` and its own commands to the command line."""
    parser = subparsers.add_parser("datasets", help="make, convert, list and describe sequences")
    kinds = parser.add_subparsers(required=True, metavar="COMMAND")

    parser = kinds.add_parser("make", help="render a synthetic sequence")
    parser.add_argument(
        "scene",
        choices=(*SCENES, ALL),
        metavar="SCENE",
        help=f"see `list`; {ALL}: those learned on and those held out",
    )
    parser.add_argument("--frames", type=int, metavar="N", help="default: the scene's own number")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"with {ALL} default: $FRONTRUNNER_VAR/sequences"
    )
    parser.add_argument("--noise", choices=("kinect", "none"), default="kinect")
    parser.add_argument("--seed", type=int, default=SEED, metavar="S")
    parser.add_argument("--motion", choices=tuple(MOTIONS), help="default: the scene's own")
    parser.add_argument("--size", type=_ratio, default=1, metavar="WxH", help="default: 640x480")
    _add_alterations(parser)
    parser.add_argument("--format", choices=FORMATS, default="pack")
    parser.add_argument("--colour", action="store_true", help="also write the pack DIR-colour")
    parser.set_defaults(execute=_make)

    parser = kinds.add_parser("convert", help="rewrite a sequence in another format")
    parser.add_argument("source", type=Path, metavar="SRC")
    parser.add_argument("target", type=Path, metavar="DST")
    parser.add_argument("--format", choices=FORMATS, help="default: by the target's suffix, otherwise pack")
    add_source_options(parser)
    parser.add_argument("--volume-size", type=number, metavar="M", help="travels in a pack")
    parser.add_argument("--initial-position", type=three_numbers, metavar="x,y,z", help="travels in a pack")
    parser.add_argument("--colour", action="store_true", help="also write the pack DST-colour")
    _add_alterations(parser)
    parser.set_defaults(execute=_convert)

    parser = kinds.add_parser("list", help="the scenes that can be made, or the packs in a folder")
    parser.add_argument(
        "folder", type=Path, nargs="?", help="of packs; default: the scenes and the shipped packs"
    )
    parser.set_defaults(execute=_list)

    parser = kinds.add_parser("info", help="describe a sequence")
    parser.add_argument("path", type=Path)
    add_source_options(parser)
    parser.set_defaults(execute=_info)

    parser = kinds.add_parser("get", help="download a public sequence")
    retrieval.register(parser)


def _add_alterations(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--dark", type=_frames, metavar="A:B", help="frames without any measurement")
    parser.add_argument(
        "--no-truth-in-dark",
        dest="truth_in_dark",
        action="store_false",
        help="leave the true poses of these frames unknown: they do not count for the error",
    )
    parser.add_argument(
        "--drop",
        type=number,
        default=0.0,
        metavar="F",
        help="leave out this fraction of the frames, at random",
    )
    parser.add_argument(
        "--focal-error", type=number, default=0.0, metavar="F",
        help="report focal lengths larger by this fraction: a camera that turns then drifts",
    )  # fmt: skip


def _frames(text: str) -> tuple[int, int]:
    first, separator, last = text.partition(":")
    if not separator:
        raise argparse.ArgumentTypeError(f"{text!r}: write the first and the last frame, as in 300:330")
    return int(first), int(last)


def _ratio(text: str) -> int:
    """The ratio of the camera's size to WxH, which must divide it."""
    common = math.gcd(CAMERA.width, CAMERA.height)
    ratios = {
        f"{CAMERA.width // ratio}x{CAMERA.height // ratio}": ratio
        for ratio in range(1, common + 1)
        if common % ratio == 0
    }
    if text not in ratios:
        sizes = ", ".join(ratios)
        raise argparse.ArgumentTypeError(f"{text!r} is not one of {sizes}: choose one")
    return ratios[text]


def _altered(sequence: Sequence, options: argparse.Namespace, seed: int = SEED) -> Sequence:
    if options.dark is not None or options.focal_error:
        sequence = Altered(sequence, options.dark, options.focal_error, options.truth_in_dark)
    return Dropped(sequence, options.drop, seed) if options.drop else sequence


def _make(options: argparse.Namespace) -> None:
    if options.frames is not None and options.frames < 1:
        raise SequenceError(f"--frames {options.frames}: a sequence has at least one frame")
    if options.seed < 0:
        raise SequenceError(f"--seed {options.seed}: give a whole number from 0 on")
    if options.scene == ALL:
        _make_all(options)
        return
    if options.out is None:
        raise UsageError(f"--out is missing: give the folder to write {options.scene} to")
    scene = _in_motion(SCENES[options.scene], options)
    sequence = SyntheticSequence(scene, options.frames, options.noise, options.seed, options.size)
    _write(_altered(sequence, options, options.seed), options.out, options.format, options.colour)


def _in_motion(scene: SyntheticScene, options: argparse.Namespace) -> SyntheticScene:
    return with_motion(scene, options.motion) if options.motion else scene


def _make_all(options: argparse.Namespace) -> None:
    """Make the depth packs that searches learn on, and the held-out ones, unless they exist."""
    if options.colour or options.format != "pack" or options.dark or options.focal_error or options.drop:
        raise UsageError(f"{ALL} makes plain packs of depth: leave out --colour, --format and alterations")

    paths = make_all(
        [_in_motion(scene, options) for scene in (*with_role("learned-on"), *with_role("held-out"))],
        options.out or default_folder(),
        options.frames,
        options.noise,
        options.seed,
        options.size,
        lambda name: progress_line(f"{name}: "),
    )
    sys.stdout.write("".join(f"{path}\n" for path in paths))


def _convert(options: argparse.Namespace) -> None:
    form = form_of(options.target, options.format)
    check_target(options.source, options.target, form)
    sequence = open_source(options, options.source)
    if options.volume_size is not None:
        if not 0 < options.volume_size <= LARGEST_VOLUME:
            raise SequenceError(f"--volume-size {options.volume_size:g}: give metres, more than 0")
        sequence.volume_size = options.volume_size
    if options.initial_position is not None:
        sequence.initial_position = options.initial_position
    _write(_altered(sequence, options), options.target, form, options.colour)


def _write(sequence: Sequence, target: Path, form: str, colour: bool) -> None:
    for text in write(sequence, target, form, colour, progress_line()):
        terminal.note(text)
    sys.stdout.write(f"{target}: {len(sequence)} frames\n")


def _list(options: argparse.Namespace) -> None:
    folder = options.folder or SEQUENCES
    if options.folder is None:
        sys.stdout.write("Scenes that `datasets make` renders:\n")
        for scene in SCENES.values():
            sys.stdout.write(f"{scene.name:18} {scene.role:10} {scene.frames:4} frames  {scene.summary}\n")
        sys.stdout.write("\nPacks on this machine:\n")
    elif not folder.is_dir():
        raise SequenceError(f"{folder} is not a folder")
    for manifest in sorted(folder.glob(f"*/{pack.MANIFEST}")):
        described = pack.read_manifest(manifest.parent)
        size = sum(chunk["bytes"] for chunk in described["chunks"])
        sys.stdout.write(
            f"{manifest.parent.name:24} {described['frames']:5} frames {described['width']}x"
            f"{described['height']} {size / 1e6:7.1f} MB {described['sha256']}\n"
        )


def _info(options: argparse.Namespace) -> None:
    sequence = open_source(options, options.path)
    if isinstance(sequence, Pack):
        sequence.verify()
    camera = sequence.camera
    facts: dict[str, Any] = {
        "name": sequence.name,
        "frames": len(sequence),
        "size": f"{camera.width}x{camera.height}",
        "camera": f"fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g}",
        "seconds": f"{sequence.timestamps[-1] - sequence.timestamps[0]:.2f}",
        "depth": _depth_summary(sequence),
        "colour": "no" if sequence.colour(0) is None else "yes",
        "truth": _truth_summary(sequence),
        "volume size": f"{sequence.volume_size:g} m" if sequence.volume_size else "not given",
        "start": ", ".join(f"{x:g}" for x in sequence.initial_position or ()) or "not given",
        "sha256": sequence.sha256,
    }
    sys.stdout.write("".join(f"{name:12} {value}\n" for name, value in facts.items()))


def _depth_summary(sequence: Sequence) -> str:
    """From the first, the middle and the last frame."""
    sampled = sample_depth(sequence)
    measured = sampled[sampled > 0]
    if not measured.size:
        return "nothing measured in three frames"
    near, middle, far = np.percentile(measured, [1, 50, 99]) / 1000
    missing = 100 * (1 - measured.size / sampled.size)
    return f"{near:.2f} to {far:.2f} m, median {middle:.2f} m, {missing:.1f} % not measured (three frames)"


def _truth_summary(sequence: Sequence) -> str:
    if sequence.truth is None:
        return "none"
    poses = sequence.truth[np.isfinite(sequence.truth).all(axis=(1, 2))]
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    text = f"{len(poses)} of {len(sequence)} frames"
    return text + (f", {1000 * steps.mean():.1f} mm a frame, {steps.sum():.2f} m" if len(steps) else "")
