"""Reports of runs, as `python -m slam run --json` writes them: reading, and summary tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.definitions import SYSTEMS
from slam.devices.build import split
from slam.reports import losses
from slam.system import STAGES
from wire.protocol import FIRST_COUNTED_FRAME, LEAST_MATCHED, VALID_BELOW

MOST_OUTSIDE = 0.5  # of what a frame measured, beyond the volume: more is worth a line
NEEDED = {"system", "frames", "ate", "valid", "configuration", "sequence", "device", "cpu_seconds"}
MEANINGS = {
    "computation": "from the upload until the pose is known: the time of a configuration",
    "acquisition": "reading and decoding the images; not part of the computation",
    "rendering": "drawing pictures (--render); not part of the computation",
    "total": "all of it",
}
ENERGY_SOURCES = {
    "rapl": "the processor's packages (RAPL)",
    "ina": "the board's rails (INA sensors)",
    "battery": "the whole device, from its battery",
}


class ReportError(ValueError):
    """A file that is not a report."""


def read(path: Path) -> Mapping[str, Any]:
    """The report in a JSON file. Raises ReportError for bad content, OSError when it cannot be read."""
    try:
        report: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        missing = NEEDED - set(report)
        if missing or not report["frames"]:
            raise ValueError(f"it lacks {', '.join(sorted(missing)) or 'frames'}")
        for name in (*stages(report), "computation"):
            milliseconds(report, name)
    except (ValueError, KeyError, TypeError) as error:
        raise ReportError(f"{path} is not a report of `python -m slam run --json`: {error}") from None
    return report


def stages(report: Mapping[str, Any]) -> tuple[str, ...]:
    """The stages with known times; none where the backend has no clock for them."""
    return tuple(stage for stage in STAGES if all(frame[stage] is not None for frame in report["frames"]))


def milliseconds(report: Mapping[str, Any], name: str) -> NDArray[np.float64]:
    """Times of a stage over the frames that count: from frame 10 on, or all where there are no more."""
    counted = report["frames"][FIRST_COUNTED_FRAME:] or report["frames"]
    # Reports of older versions have no rendering.
    times = [frame.get(name, 0.0) if name == "rendering" else frame[name] for frame in counted]
    return 1e3 * np.array(times, np.float64)


def summary(report: Mapping[str, Any]) -> str:
    """The measurements of a run, as text for people."""
    sequence, device, frames = report["sequence"], report["device"], report["frames"]
    possible = (*stages(report), *MEANINGS)
    names = [name for name in possible if name != "rendering" or milliseconds(report, name).any()]
    share = 100 / max(milliseconds(report, "computation").mean(), 1e-12)
    lines = [
        f"{report['system']} on {sequence['name']}, {len(frames)} frames of {_size(sequence)}, "
        f"{device['name']} ({device['driver']})",
        " ".join(f"{name}={_plain(value)}" for name, value in _settings(report).items()),
        "",
        f"{'':14}" + "".join(f"{head:>10}" for head in ("mean", "median", "95%", "max", "share")),
    ]
    for name in names:
        times = milliseconds(report, name)
        cells = (times.mean(), np.median(times), np.quantile(times, 0.95), times.max())
        part = f"{share * times.mean():8.1f} %" if name in (*STAGES, "computation") else ""
        lines.append((f"{name:14}" + "".join(f"{cell:10.3f}" for cell in cells) + part).rstrip())
    lines += [
        "",
        *_facts(report),
        "",
        *_explanations(report, names),
    ]
    return "\n".join(lines) + "\n"


def _settings(report: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration, and the build options that are not the default."""
    _, build = split(report.get("build", {}))  # other backends and older reports lack this
    return {**report["configuration"], **build.changed}


def _size(sequence: Mapping[str, Any]) -> str:
    whole = sequence.get("cropped_from")
    size = f"{sequence['width']}x{sequence['height']}"
    return f"{size} (cropped from {whole[0]}x{whole[1]})" if whole else size


def line(report: Mapping[str, Any]) -> str:
    """One of several sequences on one line: time, largest error, lost frames."""
    ate = report["ate"]
    error = "no true trajectory" if ate is None else f"largest error {_cm(ate['max'])}"
    lost = sum(frame["tracked"] is False for frame in report["frames"])
    skipped = skipped_frames(report["frames"])
    times = milliseconds(report, "computation")
    return (
        f"{report['sequence']['name']:16}{times.mean():9.3f} ms a frame "
        f"(95 %: {np.quantile(times, 0.95):.3f}, max {times.max():.3f}), {error}, {lost} lost"
        + (f", {_share(skipped, report)} skipped" if skipped else "")
    )


def skipped_frames(frames: Sequence[Mapping[str, Any]]) -> int:
    """How many of `frames` were not computed."""
    return sum(frame["skipped"] for frame in frames)


def _share(count: int, report: Mapping[str, Any]) -> str:
    return f"{100 * count / len(report['frames']):.0f} %"


def _waited(report: Mapping[str, Any]) -> str:
    """How long threads waited for a processor, if it is known."""
    waited, counted = report.get("waited_us"), len(report["frames"]) - FIRST_COUNTED_FRAME
    return (
        "" if waited is None else f", threads waited {1e-3 * waited / counted:.3f} ms a frame for a processor"
    )


def _outside(frames: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line where the camera saw more outside of the volume than in it."""
    many = [number for number, frame in enumerate(frames) if (frame.get("outside") or 0) > MOST_OUTSIDE]
    if not many:
        return []
    return [
        f"{'outside':14}in {len(many)} of {len(frames)} frames (first {many[0]}, last {many[-1]}) more than "
        "half of what was measured lies outside the volume: "
        "choose another --volume-size or --initial-position"
    ]


def _facts(report: Mapping[str, Any]) -> list[str]:
    frames = report["frames"]
    tracked = [frame["tracked"] for frame in frames]
    degenerate = sum(frame.get("degenerate") is True for frame in frames)  # older reports lack this
    skipped = skipped_frames(frames)
    computed = sum(frame["computation"] for frame in frames)
    lines = [
        f"{'frames':14}tracked {tracked.count(True)}, lost {tracked.count(False)}, "
        + (f"skipped {skipped} ({_share(skipped, report)}), " if skipped else "")
        + f"not attempted {tracked.count(None) - skipped}; "
        f"integrated {sum(f['integrated'] for f in frames)}"
        + (f"; degenerate {degenerate}" if degenerate else ""),
        *(f"{'lost':14}{line}" for line in losses.lines(frames)),
        *_outside(frames),
        *([f"{'stopped':14}{_stopped(report['stopped'])}"] if "stopped" in report else []),
        f"{'CPU':14}{1e3 * report['cpu_seconds'] / len(frames):.3f} ms a frame, "
        f"{report['cpu_seconds'] / computed if computed else 0:.2f} cores busy" + _waited(report),
    ]
    memory, energy = report.get("peak_memory_bytes"), report.get("energy_joules")
    lines.append(f"{'memory':14}" + ("unknown" if memory is None else f"{memory / 2**20:.0f} MiB at most"))
    if energy is None:
        lines.append(f"{'energy':14}unknown: this platform does not report it")
    else:
        source = ENERGY_SOURCES.get(report.get("energy_source") or "", "source unknown")
        power = f", {energy / computed:.2f} W" if computed else ""
        lines.append(f"{'energy':14}{energy / len(frames):.4f} J a frame{power}: {source}")
    ate = report["ate"]
    if (matched := report.get("matched_poses")) is not None:  # older reports lack this
        share = 100 * matched / len(frames)
        lines.append(f"{'true poses':14}{matched} of {len(frames)} frames ({share:.0f} %)")
    if ate is None:
        lines.append(f"{'error':14}unknown: no frame has a true pose")
    else:
        lines.append(
            f"{'error':14}mean {_cm(ate['mean'])}, max {_cm(ate['max'])}, RMSE {_cm(ate['rmse'])}, "
            f"aligned {_cm(ate['rmse_aligned'])}: {_verdict(report)}"
        )
    if online := report.get("ate_online"):
        lines.append(
            f"{'online error':14}mean {_cm(online['mean'])}, max {_cm(online['max'])}, "
            f"aligned {_cm(online['rmse_aligned'])}"
        )
    if loops := report.get("loops"):
        lines.append(
            f"{'loops':14}closed {loops['local']} local, {loops['global']} global; "
            f"relocalisations {loops['relocalisations']}"
        )
    return lines


def _stopped(stop: Mapping[str, Any]) -> str:
    return f"after {stop['frames']} of {stop['wanted']} frames: {stop['reason']}"


def _verdict(report: Mapping[str, Any]) -> str:
    word = {True: "valid", False: "not valid", None: "not judged"}[report["valid"]]
    reason = report.get("not_valid_because")
    return f"{word} ({reason})" if reason else word


SKIPPED = "skipped: not computed, because the camera moved little; the pose continues the motion before"
ONLINE = "online error: of the poses as reported right after each frame"
LOOPS = (
    "loops: local, by registering the view to an older part of the map; global, by an earlier view; "
    "relocalisations: how often a lost camera was found again"
)
CLOCKS = {
    "device": "stages by the device's clock, so they add up to a little less than the computation",
    "wall": "stages by the host's clock, which waits for the device after each",
    "none": "no clock measures the stages here",
}


def _explanations(report: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    system, frames = report["system"], len(report["frames"])
    definition = SYSTEMS.get(system)
    meanings = (dict(definition.stages) if definition else {}) | MEANINGS
    counted = (
        f"over the frames from {FIRST_COUNTED_FRAME} on (earlier ones fill the model and the caches)"
        if frames > FIRST_COUNTED_FRAME
        else "over all frames, as there are few"
    )
    return [
        f"mean ... max: milliseconds a frame, {counted}",
        CLOCKS[report.get("stage_clock", "wall")],  # older reports lack this
        "95%: 95 of 100 frames took no longer; share: of the computation",
        *(f"{name}: {meanings[name]}" for name in names if name in meanings),
        *([f"not attempted: {definition.unattempted}"] if definition else []),
        *([SKIPPED] if skipped_frames(report["frames"]) else []),
        "lost: the pose failed its check; the line says when it was first lost, for how many frames, and why",
        *(
            ["degenerate: tracked, but the view lets the camera slide or turn, as a flat wall does"]
            if any(frame.get("degenerate") for frame in report["frames"])
            else []
        ),
        "CPU: of all threads during the computation; energy: likewise, all frames",
        "memory: the largest resident size of the process during the run",
        "error: distance from the true position, first poses laid on each other; RMSE: root mean square",
        *([ONLINE] if "ate_online" in report else []),
        *([LOOPS] if "loops" in report else []),
        f"aligned: RMSE after the best rigid alignment, TUM's ATE; valid: tracked, at least "
        f"{100 * LEAST_MATCHED:g} % of the frames compared with a true pose, max below {_cm(VALID_BELOW)}",
    ]


def comparison(reports: Mapping[str, Mapping[str, Any]]) -> str:
    """Reports side by side, compared with the first. Keys are their names."""
    letters = {
        name: chr(ord("A") + number % 26) + (str(number // 26) if number >= 26 else "")
        for number, name in enumerate(reports)
    }
    first = next(iter(reports.values()))
    width = 1 + max(12, *(len(report["system"]) for report in reports.values()))
    lines = [f"{letters[name]} = {name}" for name in reports]
    lines += ["", f"{'':14}" + "".join(f"{letters[name]:>{width}}" for name in reports)]

    def row(title: str, cells: Sequence[str]) -> None:
        lines.append(f"{title:14}" + "".join(f"{cell:>{width}}" for cell in cells))

    row("system", [report["system"] for report in reports.values()])
    for stage in STAGES:
        row(stage, [_mean(report, stage) if stage in stages(report) else "-" for report in reports.values()])
    row("computation", [_mean(report, "computation") for report in reports.values()])
    times = [milliseconds(report, "computation") for report in reports.values()]
    row("95%", [f"{np.quantile(each, 0.95):.3f} ms" for each in times])
    row("max", [f"{each.max():.3f} ms" for each in times])
    computation = [each.mean() for each in times]
    row("speedup", [f"{computation[0] / time:.2f}" if time else "-" for time in computation])
    row("CPU", [f"{1e3 * r['cpu_seconds'] / len(r['frames']):.3f} ms" for r in reports.values()])
    row("memory", [_mebibytes(report.get("peak_memory_bytes")) for report in reports.values()])
    for key in ("mean", "max", "rmse", "rmse_aligned"):
        errors = [report["ate"] for report in reports.values()]
        title = "aligned RMSE" if key == "rmse_aligned" else f"error {key}"
        row(title, [_cm(ate[key]) if ate else "unknown" for ate in errors])
    row("true poses", [str(report.get("matched_poses", "unknown")) for report in reports.values()])
    row("lost", [str(sum(f["tracked"] is False for f in r["frames"])) for r in reports.values()])
    if any(skipped := [skipped_frames(report["frames"]) for report in reports.values()]):
        row("skipped", [_share(n, report) for n, report in zip(skipped, reports.values(), strict=True)])
    words = {True: "yes", False: "no", None: "unknown"}
    row("valid", [words[report["valid"]] for report in reports.values()])
    lines.append("")
    settings = [_settings(report) for report in reports.values()]
    for name in sorted({name for each in settings for name in each}):
        values = [_plain(each.get(name, "-")) for each in settings]
        if len(set(values)) > 1:
            lines.append(f"{name}: {' | '.join(values)}")
    lines += [
        f"beware: they {problem}"
        for problem, key in (
            ("ran different systems", "system"),
            ("ran on different sequences", "sequence"),
            ("ran on different devices", "device"),
        )
        if any(_identity(report[key]) != _identity(first[key]) for report in reports.values())
    ]
    if any(len(report["frames"]) != len(first["frames"]) for report in reports.values()):
        lines.append("beware: they ran over different numbers of frames")
    lines += [
        "stages and computation: mean time a frame, as in `run`; 95%, max: of the computation",
        "speedup: of the mean computation, over A",
        "CPU: of all threads, a frame; lost: frames whose pose failed the check",
        f"error: distance from the truth, first poses laid on each other; valid: tracked, at least "
        f"{100 * LEAST_MATCHED:g} % of the frames compared with a true pose, max below {_cm(VALID_BELOW)}",
    ]
    return "\n".join(lines) + "\n"


def _mean(report: Mapping[str, Any], name: str) -> str:
    return f"{milliseconds(report, name).mean():.3f} ms"


def _cm(metres: float) -> str:
    return f"{100 * metres:.2f} cm"


def _identity(description: str | Mapping[str, Any]) -> Any:
    """The identity of a description: for a sequence its digest."""
    return description if isinstance(description, str) else description.get("sha256") or dict(description)


def _mebibytes(size: int | None) -> str:
    return "unknown" if size is None else f"{size / 2**20:.0f} MiB"


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
