"""The commands `run`, `compare`, `surface`, `evaluate`, `devices`, `plan` and `reference`."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slam import bands, compare, mesh, reference_times, report, report_log, report_page, surface
from slam.arguments import (
    UsageError,
    four_numbers,
    number,
    progress_line,
    setting,
    three_numbers,
    values,
    writable,
)
from slam.benchmark import Observer, Report, run
from slam.datasets import Sequence, open_sequence
from slam.datasets.altered import Perturbed
from slam.devices.choice import AnySession, choose_device, list_devices
from slam.devices.device import BACKENDS
from slam.devices.layout import KINDS, Layout
from slam.devices.opencl import list_refusals
from slam.evaluation import evaluate
from slam.protocol import fixed_pairs
from slam.render import Renderer
from slam.system import Exporting, System, scene_of
from slam.systems import SYSTEMS, complete, definition, frame_plan, open_session, require_backend
from slam.trajectory import MAXIMAL_STAMP_DIFFERENCE, Trajectory

Commands = argparse._SubParsersAction  # of argparse.ArgumentParser


def register(subparsers: Commands[argparse.ArgumentParser]) -> None:
    """Add the commands of this module to the command line."""
    for add in (_add_run, _add_compare, _add_surface, _add_evaluate):
        add(subparsers)
    parser = subparsers.add_parser("devices", help="the OpenCL and WebGPU devices here, best first")
    parser.set_defaults(execute=_devices)
    parser = subparsers.add_parser("plan", help="write what happens in a frame, as data (JSON)")
    _add_scene_options(parser)
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument("--layout", choices=KINDS, default="pixels", help="of the kernels; default: pixels")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.set_defaults(execute=_plan)
    parser = subparsers.add_parser(
        "reference",
        help="make a front one of protocol 2: a trajectory and a band for each configuration and probe, from "
        "all devices here",
    )
    parser.add_argument("--front", type=Path, required=True, metavar="FILE", help="JSON with configurations")
    parser.add_argument("--sequence", type=Path, required=True, metavar="PATH")
    parser.add_argument("--frames", type=int, metavar="N", help="the first N (default: the front's protocol)")
    parser.add_argument(
        "--rounds",
        type=int,
        default=reference_times.ROUNDS,
        metavar="N",
        help="in which each is timed beside the default; 0: none (default: %(default)s)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.set_defaults(execute=_reference)


def _add_run(subparsers: Commands[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser("run", help="measure one configuration over one or more sequences")
    _add_run_options(parser, several=True)
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument("--json", metavar="FILE", help="write the report, - for standard output")
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
        help="change each measured depth by -1, 0 or +1 units: an error that depends on it stands on an edge",
    )
    parser.add_argument(
        "--stop-above", type=number, metavar="M", help="run no further sequence after a largest error above M"
    )
    parser.add_argument(
        "--stop-after", type=int, default=1, metavar="N", help="... after N such sequences (default 1)"
    )
    parser.set_defaults(execute=_run)


def _add_compare(subparsers: Commands[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser("compare", help="reports or configurations side by side")
    parser.add_argument(
        "items",
        nargs="+",
        metavar="ITEM",
        help='a report (.json), or settings to run, as in "mu=0.2 compute_size_ratio=2"; an empty text is '
        "the default configuration. The first is what the others are compared with",
    )
    parser.add_argument("--html", type=Path, metavar="FILE", help="draw times and errors (needs Plotly)")
    _add_run_options(parser, needs_sequence=False)
    parser.set_defaults(execute=_compare)


def _add_surface(subparsers: Commands[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "surface", help="time and error over a grid of two parameters' values; goes on where it stopped"
    )
    for axis in ("x", "y"):
        parser.add_argument(f"--{axis}", required=True, metavar="NAME", help="a parameter of the system")
        parser.add_argument(
            f"--{axis}-values", type=values, metavar="A,B,...", help="default: those of the design space"
        )
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="for surface.csv and surface.html"
    )
    _add_run_options(parser)
    parser.set_defaults(execute=_surface)


def _add_evaluate(subparsers: Commands[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser("evaluate", help="the errors of an estimated trajectory, as JSON")
    parser.add_argument("--estimate", type=Path, required=True, metavar="FILE")
    parser.add_argument("--truth", type=Path, required=True, metavar="FILE")
    parser.add_argument("--align", choices=("first", "se3", "sim3"), default="first")
    parser.add_argument(
        "--delta", type=int, default=1, metavar="N", help="frames between the poses of the relative error"
    )
    parser.add_argument(
        "--max-difference", type=float, default=MAXIMAL_STAMP_DIFFERENCE, metavar="S", help="between stamps"
    )
    parser.set_defaults(execute=_evaluate)


def _add_run_options(
    parser: argparse.ArgumentParser, needs_sequence: bool = True, several: bool = False
) -> None:
    _add_scene_options(parser, needs_sequence, several)
    parser.add_argument("--frames", type=int, metavar="N", help="the first N (default: all)")
    parser.add_argument("--backend", choices=BACKENDS, default="opencl", help="default: opencl")
    parser.add_argument("--device", metavar="TEXT", help="a part of the device's description")


def _add_scene_options(
    parser: argparse.ArgumentParser, needs_sequence: bool = True, several: bool = False
) -> None:
    parser.add_argument("--system", choices=sorted(SYSTEMS), default="kfusion")
    parser.add_argument(
        "--sequence",
        type=Path,
        required=needs_sequence,
        metavar="PATH",
        **({"action": "append", "help": "repeat it to run over several in turn"} if several else {}),
    )
    parser.add_argument(
        "--camera",
        type=four_numbers,
        metavar="fx,fy,cx,cy",
        help="for a .raw file, or instead of what the folder or .slam file says",
    )
    parser.add_argument("--truth", type=Path, metavar="FILE", help="a TUM trajectory")
    parser.add_argument(
        "--volume-size", type=number, metavar="M",
        help="of kfusion's volume (elasticfusion has none); default: the sequence's, or 5 m",
    )  # fmt: skip
    parser.add_argument(
        "--initial-position", type=three_numbers, metavar="x,y,z",
        help="of the camera in it, as fractions of its side; likewise of kfusion alone",
    )  # fmt: skip


def _open(options: argparse.Namespace, path: Path | None = None) -> Sequence:
    require_backend(options.system, getattr(options, "backend", BACKENDS[0]))
    if options.volume_size is not None and options.volume_size <= 0:
        raise UsageError(f"--volume-size {options.volume_size:g}: give metres, more than 0")
    return open_sequence(path or options.sequence, options.camera, options.truth)


def _measure(
    options: argparse.Namespace,
    configuration: Mapping[str, Any],
    sequence: Sequence,
    session: AnySession | None = None,
    label: str = "",
    observe: Observer | None = None,
) -> Report:
    return run(
        configuration,
        sequence,
        system=options.system,
        frames=options.frames,
        device=session or options.device,
        backend=options.backend,
        volume_size=options.volume_size,
        initial_position=options.initial_position,
        progress=progress_line(label),
        observe=observe,
    )


def _settings(parts: list[dict[str, Any]]) -> dict[str, Any]:
    return {name: value for part in parts for name, value in part.items()}


class _Observers:
    """Draws pictures where asked for, and keeps the system so that its surface can be extracted."""

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
    configuration = complete(options.system, _settings(options.set))
    several = len(options.sequence) > 1
    found, lines = _run_several(options, configuration) if several else _run_one(options, configuration)
    text = json.dumps(found, indent=1, allow_nan=False) + "\n"
    if json_path:
        json_path.write_text(text, encoding="utf-8")
    if options.json == "-":
        sys.stdout.write(text)
    else:
        sys.stdout.write("\n".join(lines) + "\n")


def _run_one(
    options: argparse.Namespace, configuration: Mapping[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """The report of the one sequence, and the lines to print."""
    sequence = _sequences(options)[0]
    renderer = Renderer(options.render, options.render_every) if options.render else None
    observers = _Observers(renderer) if renderer or options.mesh else None
    result = _measure(options, configuration, sequence, observe=observers)
    if options.trajectory:
        result.trajectory().write(options.trajectory)
    if options.tsv:
        options.tsv.write_text(report_log.log(result), encoding="utf-8")
    lines = [report.summary(result.to_dict()).rstrip("\n")]
    if renderer:
        lines.append(f"{renderer.written} pictures in {options.render}")
    if options.mesh and observers:
        lines.append(_write_mesh(observers.system, options.mesh))
    return result.to_dict(), lines


def _run_several(
    options: argparse.Namespace, configuration: Mapping[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """The reports of all sequences up to where `--stop-above` ends, and a line about each."""
    for name in ("trajectory", "tsv", "mesh", "render"):
        if getattr(options, name):
            raise UsageError(f"--{name} belongs to one sequence: {len(options.sequence)} are given")
    sequences = _sequences(options)
    session = open_session(options.system, choose_device(options.device, options.backend))
    reports: list[dict[str, Any]] = []
    above = 0
    for sequence in sequences:
        result = _measure(options, configuration, sequence, session, f"{sequence.name}: ")
        reports.append(result.to_dict())
        limit = options.stop_above
        above += limit is not None and result.ate is not None and not result.ate.max <= limit
        if above >= options.stop_after:
            break
    lines = [report.line(found) for found in reports]
    if len(reports) < len(sequences):
        lines.append(f"{len(sequences) - len(reports)} not run: the largest error is above {limit:g} m")
    return {"runs": reports}, lines


def _sequences(options: argparse.Namespace) -> list[Sequence]:
    """All sequences of `run`, opened, and perturbed where that is wanted."""
    opened = [_open(options, path) for path in options.sequence]
    return opened if options.perturb is None else [Perturbed(found, options.perturb) for found in opened]


def _write_mesh(system: System | None, path: Path) -> str:
    if isinstance(system, Exporting):
        return system.export(path)
    if not isinstance(system, mesh.Volumetric):
        raise UsageError("--mesh: this system holds neither surfels nor a volume of distances")
    surface_mesh = mesh.extract(system.volume)
    surface_mesh.write(path)
    return f"{len(surface_mesh.vertices)} vertices and {len(surface_mesh.triangles)} triangles in {path}"


def _compare(options: argparse.Namespace) -> None:
    writable(options.html)
    if options.html:
        report_page.plotly()
    # Everything is read and checked before anything is measured.
    wanted = [(text, *_item(text, options)) for text in options.items]
    measured = [text for text, found, _ in wanted if found is None]
    sequence = _open(options) if measured else None
    session = (
        open_session(options.system, choose_device(options.device, options.backend)) if measured else None
    )
    reports: dict[str, Mapping[str, Any]] = {}
    for text, found, configuration in wanted:
        name = text.strip() or "default"
        while name in reports:  # the same twice: to see how measurements repeat
            name += " again"
        if sequence is not None and found is None:
            found = _measure(options, configuration, sequence, session, f"{name}: ").to_dict()
        assert found is not None
        reports[name] = found
    sys.stdout.write(report.comparison(reports))
    if options.html:
        report_page.save(options.html, "Comparison of runs", compare.figures(reports))


def _item(text: str, options: argparse.Namespace) -> tuple[Mapping[str, Any] | None, dict[str, Any]]:
    """The report in a file, or None and the configuration to run."""
    if text.endswith(".json"):
        return report.read(Path(text)), {}
    if options.sequence is None:
        raise UsageError(f"{text!r} is no report (.json), so it is run: give --sequence")
    try:
        parts = [setting(part) for part in text.split()]
    except argparse.ArgumentTypeError as error:
        raise UsageError(str(error)) from None
    return None, complete(options.system, _settings(parts))


def _surface(options: argparse.Namespace) -> None:
    known = definition(options.system).values
    for name in (options.x, options.y):
        if name not in known:
            raise UsageError(f"{name!r}: {options.system} has the parameters {', '.join(sorted(known))}")
    grid = surface.Grid(
        options.x,
        options.y,
        options.x_values or known[options.x],
        options.y_values or known[options.y],
    )
    report_page.plotly()
    fixed = _settings(options.set)
    sequence = _open(options)
    if sequence.truth is None:
        raise UsageError(f"{options.sequence} has no true trajectory, so no error to draw: give --truth FILE")
    session = open_session(options.system, choose_device(options.device, options.backend))
    options.out.mkdir(parents=True, exist_ok=True)
    total, done = len(grid.x_values) * len(grid.y_values), 0

    def measured(configuration: Mapping[str, Any]) -> Report:
        nonlocal done
        done += 1
        point = f"{grid.x}={configuration[grid.x]:g} {grid.y}={configuration[grid.y]:g}"
        label = f"run {done} of at most {total}, {point}: "
        return _measure(options, configuration, sequence, session, label)

    device = session.device.describe()
    conditions = {
        "system": options.system,
        "sequence": sequence.sha256,
        "frames": options.frames or len(sequence),
        "volume_size": options.volume_size,
        "initial_position": options.initial_position,
        "device": f"{device['name']} {device['driver']}",
    }
    found = surface.measure(
        grid,
        lambda point: complete(options.system, fixed | dict(point)),
        measured,
        conditions,
        options.out / "surface.csv",
    )
    title = f"{options.system} on {sequence.name}, {device['name']}"
    report_page.save(options.out / "surface.html", "Response surface", surface.figures(grid, found, title))
    sys.stdout.write(surface.table(grid, found))
    sys.stdout.write(f"measured {done}, known before {total - done}: {options.out / 'surface.csv'}\n")
    sys.stdout.write(f"drawn in {options.out / 'surface.html'}\n")


def _evaluate(options: argparse.Namespace) -> None:
    estimate, truth = Trajectory.read(options.estimate), Trajectory.read(options.truth)
    result = evaluate(estimate, truth, options.align, options.delta, options.max_difference)
    sys.stdout.write(json.dumps(result, indent=1) + "\n")


def _plan(options: argparse.Namespace) -> None:
    writable(options.out)
    configuration = complete(options.system, _settings(options.set))
    sequence = _open(options)
    scene = scene_of(sequence, options.volume_size, options.initial_position)
    found = frame_plan(options.system, configuration, scene, Layout(options.layout))
    options.out.write_text(found.to_json(), encoding="utf-8")
    sys.stdout.write(f"{len(found.dispatches)} dispatches on {len(found.buffers)} buffers in {options.out}\n")


def _reference(options: argparse.Namespace) -> None:
    writable(options.out)
    front = bands.read_front(options.front)
    sequence = open_sequence(options.sequence)
    frames = options.frames or front.get("protocol", {}).get("frames") or len(sequence)
    if not 1 <= frames <= len(sequence):
        raise UsageError(f"--frames {frames}: give 1 to {len(sequence)}, all that {sequence.name!r} has")
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
        largest, band = 1e3 * max(found.deviations.values()), 1e3 * found.band
        note = ": left out, devices here do not agree" if unsteady else ""
        sys.stdout.write(f"{name}: largest deviation {largest:.2f} mm, band {band:.2f} mm{note}\n")
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
    """Give each of POINTS its times on SEQUENCE, beside those of the default; the device that measured."""
    parameters = {point["name"]: point["parameters"] for point in points}
    if reference_times.DEFAULT not in parameters:
        raise UsageError("--front: no configuration is called default to time others beside: give --rounds 0")
    progress = progress_line("times: ", "run")
    times, device = reference_times.on_sequence(parameters, sequence, frames, rounds, progress)
    for point in points:
        point.setdefault("predicted", {})["on_sequence"] = times[point["name"]]
    return device


def _devices(_: argparse.Namespace) -> None:
    # Without any device, choosing one raises the error that says what to install.
    present = []
    for backend in BACKENDS:
        with contextlib.suppress(ImportError):  # its package is not installed, or does not load here
            present += list_devices(backend)
    for device in present or [choose_device()]:
        sizes = [
            f"{device.compute_units} units" if device.compute_units else "",
            f"{device.global_memory / 2**30:.1f} GiB" if device.global_memory else "",
            f"one buffer up to {device.max_allocation >> 20} MiB",
        ]
        sys.stdout.write(
            f"{device.backend:6} {device.kind:4} {device.label}, {', '.join(filter(None, sizes))}\n"
        )
    for refusal in list_refusals():
        sys.stdout.write(f"cannot be used: {refusal}\n")
