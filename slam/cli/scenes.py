"""Shared by commands that run a system: sequence, device, progress."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Mapping
from collections.abc import Sequence as Sized
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from groundwork import terminal
from groundwork.command_line import Parser
from groundwork.folders import SEQUENCES
from groundwork.terminal import progress_line
from slam.benchmark import Observer, Report, run
from slam.cli.arguments import UsageError, four_numbers, number, three_numbers
from slam.datasets import Sequence, SequenceError, open_sequence
from slam.datasets.plausibility import depth_warning
from slam.definitions import SYSTEMS, require_backend
from slam.devices.build import DEFAULT, Build
from slam.devices.choice import AnySession, choose_device
from slam.devices.device import BACKENDS
from slam.registry import open_session
from slam.stopping import Condition
from slam.trajectories.readings import AXES, reading_warnings

SHIPPED = SEQUENCES / "living-room"  # its colour lies beside it
Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


def add_run_options(parser: argparse.ArgumentParser, several: bool = False) -> None:
    """Add the options of a command that runs a system; `several`: whether it takes several sequences."""
    add_scene_options(parser, several)
    parser.add_argument("--frames", type=int, metavar="N", help="the first N (default: all)")
    parser.add_argument("--backend", choices=BACKENDS, default="opencl", help="default: opencl")
    parser.add_argument("--device", metavar="TEXT", help="a part of the device's description")


def add_scene_options(parser: argparse.ArgumentParser, several: bool = False) -> None:
    """Add the options of the scene: a sequence, its camera and its truth."""
    parser.add_argument("--system", choices=sorted(SYSTEMS), default="kfusion")
    parser.add_argument(
        "--sequence",
        type=Path,
        metavar="PATH",
        action="append" if several else "store",
        help=f"default: the living room that ships{'; repeat it to run over several in turn' * several}",
    )
    add_source_options(parser)
    parser.add_argument(
        "--volume-size", type=number, metavar="M",
        help="of kfusion's volume (elasticfusion has none); default: the sequence's, or 5 m",
    )  # fmt: skip
    parser.add_argument(
        "--initial-position", type=three_numbers, metavar="x,y,z",
        help="of the camera in it, as fractions of its side; likewise of kfusion alone",
    )  # fmt: skip


def add_source_options(parser: argparse.ArgumentParser) -> None:
    """Add what a caller may say of the files of a sequence."""
    parser.add_argument(
        "--camera",
        type=four_numbers,
        metavar="fx,fy,cx,cy",
        help="for files that hold none, or instead of what they say",
    )
    parser.add_argument(
        "--units",
        type=number,
        metavar="N",
        help="of depth images per metre: 1000 for millimetres, 5000 for TUM",
    )
    parser.add_argument("--truth", type=Path, metavar="FILE", help="a TUM trajectory")
    add_truth_axes(parser, "y-up for files called *.freiburg, as in ICL-NUIM, otherwise opencv")


def add_truth_axes(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the option for the axes of true poses; `default` is the text of its help."""
    parser.add_argument("--truth-axes", choices=AXES, help=f"of the true poses; default: {default}")


def open_source(options: argparse.Namespace, path: Path) -> Sequence:
    """The sequence `path` as `options` describe its files; a warning says where its depths are
    implausible."""
    sequence = open_sequence(path, options.camera, options.truth, options.units, options.truth_axes)
    with contextlib.suppress(SequenceError):  # a damaged frame is reported when it is reached
        warning = None if sequence.fixed_size else depth_warning(sequence)
        if warning:
            terminal.warn(warning)
    return sequence


def open_scene(options: argparse.Namespace, path: Path | None = None) -> Sequence:
    """The sequence `path`, else the one of --sequence, else the living room that ships."""
    require_backend(options.system, getattr(options, "backend", BACKENDS[0]))
    if options.volume_size is not None and options.volume_size <= 0:
        raise UsageError(f"--volume-size {options.volume_size:g}: give metres, more than 0")
    return open_source(options, path or options.sequence or SHIPPED)


def open_device(options: argparse.Namespace, build: Build = DEFAULT) -> AnySession:
    """A session on the device of `options`, with progress while kernel layouts are tried there."""
    device = choose_device(options.device, options.backend)
    return open_session(options.system, device, progress_line("trying kernel layouts: "), build)


def measure(
    options: argparse.Namespace,
    configuration: Mapping[str, Any],
    sequence: Sequence,
    session: AnySession | None = None,
    label: str = "",
    observe: Observer | None = None,
    stop_above: Sized[Condition] = (),
    build: Build = DEFAULT,
) -> Report:
    """Run `configuration` over `sequence` as `options` say, with a progress line that begins with `label`."""
    report = run(
        configuration,
        sequence,
        system=options.system,
        frames=options.frames,
        device=session or options.device,
        backend=options.backend,
        build=build,
        volume_size=options.volume_size,
        initial_position=options.initial_position,
        progress=progress_line(label),
        observe=observe,
        stop_above=stop_above,
    )
    described = report.sequence
    note_cropping(described["width"], described["height"], described.get("cropped_from"))
    _check_truth(report, sequence)
    return report


def _check_truth(report: Report, sequence: Sequence) -> None:
    """Warn where the true poses agree far better with `report` in another reading."""
    if sequence.truth is None:
        return
    estimate = report.trajectory().poses
    truth = sequence.truth[: len(estimate)]
    known = np.isfinite(truth).all(axis=(1, 2))
    if known.any():
        for text in reading_warnings(estimate[known], truth[known], sequence.truth_axes):
            terminal.warn(text)


def note_cropping(width: int, height: int, whole: Sized[int] | None) -> None:
    """Say that images of the size `whole` were cropped to `width` x `height`, unless `whole` is None."""
    if whole is not None:
        terminal.note(f"images of {whole[0]}x{whole[1]} are cropped to {width}x{height}, around their centre")


def merged(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """All settings of `parts`; the last value of a name wins."""
    return {name: value for part in parts for name, value in part.items()}
