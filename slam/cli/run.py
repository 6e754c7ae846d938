"""`run`: measure one configuration over one or more sequences."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slam.cli import front_point
from slam.cli.arguments import UsageError, condition, setting, writable
from slam.cli.scenes import (
    SHIPPED,
    Commands,
    add_run_options,
    measure,
    merged,
    open_device,
    open_scene,
)
from slam.datasets import Sequence
from slam.datasets.altered import Perturbed
from slam.datasets.decoded import Decoded
from slam.definitions import complete
from slam.devices.build import Build, split
from slam.isolated import read_report
from slam.reports import mesh, report, slambench_log
from slam.reports.render import Renderer
from slam.stopping import ERROR, TIME, find_broken
from slam.system import Exporting, System


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser("run", help="measure one configuration over one or more sequences")
    add_run_options(parser, several=True)
    parser.add_argument(
        "--set", action="append", default=[], type=setting, metavar="NAME=VALUE", help="also a JSON object"
    )
    front_point.add_options(parser)
    parser.add_argument("--json", metavar="FILE", help="write the report, - for standard output")
    parser.add_argument(
        "--objectives", action="store_true", help="end with a line of JSON, which frontrunner tune reads"
    )
    parser.add_argument("--tsv", type=Path, metavar="FILE", help="write SLAMBench's log, one line a frame")
    parser.add_argument("--trajectory", type=Path, metavar="FILE", help="write the poses in TUM format")
    parser.add_argument("--mesh", type=Path, metavar="FILE.ply", help="write the reconstructed surface")
    parser.add_argument("--render", type=Path, metavar="FOLDER", help="write pictures of the model (PNG)")
    parser.add_argument(
        "--render-every", type=int, default=10, metavar="N", help="of every N-th frame (default 10)"
    )
    parser.add_argument(
        "--perturb",
        type=int,
        metavar="SEED",
        help="change each measured depth by -1, 0 or +1 units, to test whether an error depends on rounding",
    )
    parser.add_argument(
        "--decoded",
        type=Path,
        metavar="FOLDER",
        help="keep decoded depth in FOLDER, so that later runs need not decode it (2 bytes a pixel)",
    )
    parser.add_argument(
        "--stop-above", action="append", default=[], type=condition, metavar="NAME=VALUE,..",
        help="end the run, and run no further sequence, once ate_max (metres) or runtime (seconds a frame), "
        "or both, are certainly above that",
    )  # fmt: skip
    parser.add_argument(
        "--stop-after", type=int, default=1, metavar="N", help="... after N such sequences (default 1)"
    )
    parser.set_defaults(execute=_run)


class _Observers:
    """Draws pictures on request, and keeps the system so that its surface can be extracted."""

    def __init__(self, renderer: Renderer | None) -> None:
        self.renderer = renderer
        self.system: System | None = None

    def __call__(self, index: int, system: System) -> None:
        self.system = system
        if self.renderer:
            self.renderer(index, system)


def _run(options: argparse.Namespace) -> None:
    json_path = Path(options.json) if options.json and options.json != "-" else None
    for path in (json_path, options.tsv, options.trajectory, options.mesh):
        writable(path)
    if options.render_every < 1:
        raise UsageError(f"--render-every {options.render_every}: give 1 or more")
    if options.stop_after < 1:
        raise UsageError(f"--stop-after {options.stop_after}: give 1 or more")
    parameters, build = split(front_point.parameters(options) or _settings(options))
    configuration = complete(options.system, parameters)
    options.sequence = options.sequence or [SHIPPED]
    several = len(options.sequence) > 1
    document, lines = (_run_several if several else _run_one)(options, configuration, build)
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    if json_path:
        json_path.write_text(text, encoding="utf-8")
    if options.json == "-":
        sys.stdout.write(text)
    else:
        sys.stdout.write("\n".join(lines) + "\n")
    if options.objectives:
        sys.stdout.write(json.dumps(read_report(document).objectives) + "\n")


def _settings(options: argparse.Namespace) -> dict[str, Any]:
    """The parameters of --set; a configuration of a space of several systems names its system, too."""
    settings = merged(options.set)
    system = settings.pop("system", options.system)
    if system != options.system:
        raise UsageError(f"--set has the system {system!r}: give --system {system}, not {options.system}")
    return settings


def _run_one(
    options: argparse.Namespace, configuration: Mapping[str, Any], build: Build
) -> tuple[dict[str, Any], list[str]]:
    """The report of the one sequence, and the lines to print."""
    sequence = _sequences(options)[0]
    renderer = Renderer(options.render, options.render_every) if options.render else None
    observers = _Observers(renderer) if renderer or options.mesh else None
    result = measure(
        options, configuration, sequence, observe=observers, stop_above=options.stop_above, build=build
    )
    if options.trajectory:
        result.trajectory().write(options.trajectory)
    if options.tsv:
        options.tsv.write_text(slambench_log.log(result), encoding="utf-8")
    lines = [report.summary(result.to_dict()).rstrip("\n")]
    if renderer:
        lines.append(f"{renderer.written} pictures in {options.render}")
    if options.mesh and observers:
        lines.append(_write_mesh(observers.system, options.mesh))
    return result.to_dict(), lines


def _run_several(
    options: argparse.Namespace, configuration: Mapping[str, Any], build: Build
) -> tuple[dict[str, Any], list[str]]:
    """The reports of all sequences until `--stop-above` ends the run, and a line for each."""
    for name in ("trajectory", "tsv", "mesh", "render"):
        if getattr(options, name):
            raise UsageError(f"--{name} needs exactly one sequence, got {len(options.sequence)}")
    if any(TIME in one for one in options.stop_above):
        raise UsageError(f"--stop-above: {TIME} is the mean of all sequences here, give only {ERROR}")
    sequences = _sequences(options)
    session = open_device(options, build)
    reports: list[dict[str, Any]] = []
    above = 0
    for sequence in sequences:
        label = f"{sequence.name}: "
        result = measure(options, configuration, sequence, session, label, stop_above=options.stop_above)
        reports.append(result.to_dict())
        if result.ate is not None and find_broken(options.stop_above, {ERROR: result.ate.max}):
            above += 1
        if above >= options.stop_after:
            break
    lines = [report.line(each) for each in reports]
    if len(reports) < len(sequences):
        missing = len(sequences) - len(reports)
        lines.append(f"{missing} not run: the largest error is above the limit of --stop-above")
    return {"runs": reports}, lines


def _sequences(options: argparse.Namespace) -> list[Sequence]:
    """All sequences of `run`, opened, and perturbed on request."""
    opened = [open_scene(options, path) for path in options.sequence]
    if options.decoded is not None:
        opened = [Decoded(sequence, options.decoded) for sequence in opened]
    return (
        opened if options.perturb is None else [Perturbed(sequence, options.perturb) for sequence in opened]
    )


def _write_mesh(system: System | None, path: Path) -> str:
    if isinstance(system, Exporting):
        return system.export(path)
    if not isinstance(system, mesh.Volumetric):
        raise UsageError("--mesh: this system has no surfels and no distance volume")
    surface_mesh = mesh.extract(system.volume)
    surface_mesh.write(path)
    return f"{len(surface_mesh.vertices)} vertices and {len(surface_mesh.triangles)} triangles in {path}"
