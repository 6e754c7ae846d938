"""The results of a session, for its participant: stages, speedups, drift, the rank among other devices."""

from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean, median
from typing import Any

from client_kit.delivery.manifest import Manifest
from client_kit.measuring.session import Run, Session
from wire.front import DEFAULT
from wire.session import OptionalReading
from wire.session_statistics import PROCESSOR, wide_range

BAR = 28
# Of the later half of a session's readings over the earlier one: a smaller change explains no slowdown.
LEAST_HEATING_C, LEAST_CLOCK_LOSS = 5.0, 0.05


def run_lines(run: Run, asked: Manifest, adapts: bool = False) -> list[str]:
    """A finished run in a line, and a second line if it left its band and does not count.

    `adapts`: its configuration leaves out frames by the camera's motion; the line says how many.
    """
    start = f"  {run.order + 1}. {run.configuration}: "
    if run.status == "failed":
        return [f"{start}failed, {run.failure}"]
    most, longest = run.slowest_seconds(asked.protocol)
    line = f"{start}{1000 * run.mean_seconds(asked.protocol):.2f} ms a frame"
    line += f" (95 % within {1000 * most:.2f}, longest {1000 * longest:.2f})"
    if adapts:
        line += f", {100 * run.skipped(asked.protocol):.0f} % of frames skipped"
    if run.ate_max is not None:
        line += f", largest error {100 * run.ate_max:.2f} cm"
    if not run.deviates(asked):
        return [line]
    assert run.deviation is not None
    return [
        line,
        f"     This device computes a different result ({100 * run.deviation:.2f} cm from the reference, "
        f"{100 * asked.by_name[run.configuration].band:.2f} cm allowed), so the run does not count.",
    ]


def figures(session: Session, asked: Manifest) -> list[str]:
    """The session's outcome, one line for each configuration against the default."""
    names = list(dict.fromkeys(run.configuration for run in session.runs))
    lines = [""]
    for name in names:
        errors = [run.ate_max for run in session.of(name) if run.ate_max is not None]
        if errors:
            limit = f"{100 * asked.protocol.max_ate:.0f} cm allowed"
            lines.append(f"{name}: largest trajectory error {100 * max(errors):.2f} cm ({limit})")
    for name in names:
        if name != DEFAULT:
            lines += _speedup(session, name, asked)
    slower = session.slowed_down(asked.protocol)
    if slower is not None:
        why = _slowdown_reason(session, asked)
        lines.append(f"The later runs of every configuration took {100 * (slower - 1):.0f} % longer: {why}.")
    return lines


def stages(session: Session, asked: Manifest) -> list[str]:
    """Bars of the mean time of each stage and of the whole frame, which is longer than the sum of stages: the
    default above the fastest that counts."""
    fastest = _fastest(session, asked)
    base = _stage_means(session.of(DEFAULT), asked)
    if fastest is None or not base:
        return []
    rows = {DEFAULT: base, fastest: _stage_means(session.of(fastest), asked)}
    longest = max(max(means.values()) for means in rows.values())
    stage_width, name_width = max(map(len, base)), max(map(len, rows))
    lines = ["", "Mean time a frame, by stage"]
    for stage in base:
        for name, means in rows.items():
            bar = "#" * max(round(BAR * means[stage] / longest), 1 if means[stage] else 0)
            label = stage if name == DEFAULT else ""
            lines.append(
                f"  {label:<{stage_width}}  {name:<{name_width}}  {bar:<{BAR}} {1000 * means[stage]:9.3f} ms"
            )
    return lines


def rank_line(crowd: Iterable[Mapping[str, Any]], own: float, device: str, backend: str) -> str:
    """The rank of a speedup of `own` among the crowd's, rows of GET /speedups for one configuration.

    A device counts once; rows of this `device` and of other backends are ignored.
    """
    best: dict[str, float] = {}
    for row in crowd:
        if row["device"] != device and row["backend"] == backend:
            best[row["device"]] = max(float(row["speedup"]), best.get(row["device"], 0.0))
    if not best:
        return "No other device has measured this front yet."
    above = sum(speedup > own for speedup in best.values())
    return (
        f"Place {above + 1} of {len(best) + 1} devices by speedup; half of the others gain "
        f"{median(best.values()):.2f} or more."
    )


def best_speedup(session: Session, asked: Manifest) -> tuple[str, float] | None:
    """The configuration to compare with the crowd, `best` if it counts, with its speedup; None if that has no
    point, see `wide_range`."""
    name = "best" if session.speedup("best", asked) else _fastest(session, asked)
    speedup = None if name is None else session.speedup(name, asked)
    if name is None or speedup is None or wide_range(speedup.low, speedup.high):
        return None
    return name, speedup.value


def _speedup(session: Session, name: str, asked: Manifest) -> list[str]:
    speedup = session.speedup(name, asked)
    if speedup is None:
        return [f"No speedup for {name}: no pair of runs ran through and stayed within the limits."]
    counted = asked.protocol.frames - asked.protocol.first_counted_frame
    slower = "" if speedup.value >= 1 else " (slower)"
    interval = "one pair of runs" if speedup.pairs == 1 else f"{speedup.pairs} pairs of runs"
    if speedup.low is not None and speedup.high is not None:
        interval += f", 95 % interval {speedup.low:.2f} to {speedup.high:.2f}"
    by_processor = ", by processor time" if speedup.clock == PROCESSOR else ""
    if wide := wide_range(speedup.low, speedup.high):
        lines = [
            f"Speedup of {name} over default{by_processor}: between {wide[0]:.2f} and {wide[1]:.2f}, the "
            f"95 % interval of {speedup.pairs} pairs of runs. They differ too much to give one number."
        ]
    else:
        lines = [
            f"Speedup of {name} over default{by_processor}: {speedup.value:.2f}{slower}, mean over {counted} "
            f"frames a run; {interval}.",
            f"On this device {name} computes a frame in {100 / speedup.value:.0f} % of the default's time.",
        ]
    if by_processor:
        lines.append(
            "Other programs used this processor, so processor times are compared, which is less exact. For a "
            "narrower interval, close them and measure again."
        )
    elif speedup.contended:
        lines.append(
            f"Other programs used this processor while {name} or default was measured, so the speedup does "
            "not count and has no interval: close them and measure again."
        )
    elif speedup.changed:
        lines.append(
            f"The speedup of {name} changed while it was measured, so it does not count: close other "
            "programs and measure again."
        )
    return lines


def _slowdown_reason(session: Session, asked: Manifest) -> str:
    """What the session's own readings say of its slowdown."""
    if session.contended(asked.protocol):
        return "other programs used this processor"
    cold, hot = _halves([sample.temperature_c for sample in session.samples])
    if hot - cold >= LEAST_HEATING_C:
        return f"the device got hotter, from {cold:.0f} to {hot:.0f} °C"
    fast, slow = _halves([sample.cpu_mhz for sample in session.samples])
    if slow < (1 - LEAST_CLOCK_LOSS) * fast:
        return f"the processor's clock fell from {fast:.0f} to {slow:.0f} MHz"
    return "the processor was slower for a while"


def _halves(readings: Sequence[OptionalReading]) -> tuple[float, float]:
    """The means of the earlier and the later half of the `readings` that there are; 0 for fewer than two."""
    read = [reading for reading in readings if isinstance(reading, float | int)]
    half = len(read) // 2
    return (fmean(read[:half]), fmean(read[-half:])) if half else (0.0, 0.0)


def _fastest(session: Session, asked: Manifest) -> str | None:
    names = {run.configuration for run in session.runs} - {DEFAULT}
    speedups = {name: speedup.value for name in names if (speedup := session.speedup(name, asked))}
    return max(speedups, key=lambda name: speedups[name], default=None)


def _stage_means(runs: Sequence[Run], asked: Manifest) -> dict[str, float]:
    """Mean seconds a frame in each stage and in all, over the runs that count; empty without stages."""
    counted = [run for run in runs if run.valid(asked)]
    each = [run.stage_seconds(asked.protocol) for run in counted]
    if not each or not each[0]:
        return {}
    means = {stage: fmean(one[stage] for one in each) for stage in each[0]}
    return means | {"all": fmean(run.mean_seconds(asked.protocol) for run in counted)}
