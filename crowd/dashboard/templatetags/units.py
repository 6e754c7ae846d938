"""Template filters for crowd.dashboard.formats. Every number on a page uses one of them."""

from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import datetime
from functools import wraps
from statistics import fmean
from typing import Any

from django import template
from django.conf import settings
from django.utils.html import conditional_escape, format_html
from django.utils.safestring import SafeString, mark_safe

from crowd.dashboard import formats
from crowd.dashboard.content import confirmation
from crowd.dashboard.content.parameter_meanings import meaning_of
from crowd.dashboard.content.stages import tracking
from crowd.devices.naming import chips
from crowd.records.device import Device
from crowd.records.session import SessionSpeedup
from crowd.records.speedup import Speedup
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.rows import ModelOutcomes, RunSeries, SessionDetail
from crowd.results.validity.rules import RULES
from slam.public_text import without_folders
from wire.front import Protocol
from wire.protocol import FIRST_COUNTED_FRAME, MAX_DRIFT, VALID_BELOW

register = template.Library()


FORMATS: dict[str, Callable[..., str]] = {
    "speedup": formats.speedup,
    "gain": formats.gain,
    "milliseconds": formats.milliseconds,
    "fps": formats.frames_per_second,
    "frames": formats.frames,
    "centimetres": formats.centimetres,
    "data_size": formats.data_size,
    "count": formats.count,
    "percent": formats.percent,
    "change": formats.change,
    "coefficient": formats.coefficient,
    "plural": formats.plural,
    "parameter": formats.parameter,
    "words": formats.words,
    "meaning": meaning_of,
    "objective": formats.objective,
    "objectives": formats.objectives,
    "application": formats.application,
    "model": formats.model,
    "duration": formats.duration,
    "public": without_folders,
    "hour": formats.hour,
    "day": formats.day,
}


def _defined(function: Callable[..., str]) -> Callable[..., str]:
    """`function` with None in place of "", which Django passes for a missing variable."""

    @wraps(function)
    def formatted(value: Any, *arguments: Any) -> str:
        return function(None if value == "" else value, *arguments)

    return formatted


for name, function in FORMATS.items():
    register.filter(name, _defined(function))


@register.simple_tag
def interval(low: float | str | None, high: float | str | None) -> str:
    """A confidence interval of speedups; "" stands for a missing figure."""
    return formats.interval(None if isinstance(low, str) else low, None if isinstance(high, str) else high)


@register.simple_tag
def speedup_of(figure: Speedup | SessionSpeedup | None) -> str:
    """The speedup of `figure`, or the wide interval that is shown in its place."""
    return formats.speedup(figure.speedup, figure.range) if figure else formats.ABSENT


@register.simple_tag
def interval_of(figure: Speedup | None) -> str:
    """The interval of `figure` over installations, else that of the one session behind it, which is said."""
    if not figure:
        return formats.ABSENT
    if figure.low is None and figure.session_low is not None:
        one = formats.interval(figure.session_low, figure.session_high)
        return format_html("{} <small>one session</small>", one)
    return formats.interval(figure.low, figure.high)


@register.simple_tag
def max_drift() -> str:
    """The slowdown of repeats from which pages point it out."""
    return formats.change(MAX_DRIFT)


@register.filter
def at_least(text: str, censored: Collection[str]) -> str:
    """`text`, an error, marked as a lower bound if errors are among the objectives that are `censored`."""
    return f"at least {text}" if any(name.startswith("ate_") for name in censored) else text


@register.filter
def since(moment: datetime | None, now: datetime) -> str:
    """The time since `moment`."""
    return formats.duration((now - moment).total_seconds() if moment else None)


@register.filter
def or_absent(text: str | None) -> str:
    """`text`, or the sign for unknown values."""
    return text or formats.ABSENT


@register.filter
def backend(name: str) -> str:
    """The name of a backend for people."""
    return BACKENDS.get(name, name)


@register.filter
def value(mapping: Mapping[str, Any], key: str) -> Any:
    """The item `key` of `mapping`, or None. Templates cannot look up by a variable."""
    return mapping.get(key)


@register.filter
def pack_size(sequence: Mapping[str, Any]) -> int:
    """The bytes that a client downloads for `sequence`, including its colour."""
    colour = sequence.get("colour") or {}
    return sum(chunk["bytes"] for pack in (sequence, colour) for chunk in pack.get("chunks", ()))


@register.filter
def rule(code: str) -> str:
    """The rule `code` in a sentence; `code` itself if unknown."""
    return RULES[code].words if code in RULES else code


@register.filter
def device_text(device: Any) -> str:
    """The device of a provenance in a few words: the chip that its driver names, or the name it has."""
    if isinstance(device, Mapping):
        device = device.get("name") or formats.parameter(device)
    name = str(device or "")
    graphics = chips.graphics(name)
    return graphics.name if graphics else chips.processor(name) or name


@register.filter
def parts(device: Device) -> str:
    """The known parts of a device."""
    known = dict.fromkeys(part for part in (device.gpu, device.soc, device.cpu, device.os) if part)
    return ", ".join(known) or "Its parts are not known."


@register.filter
def suspects(rows: Sequence[Speedup]) -> int:
    """The number of `rows` that are suspect."""
    return sum(row.suspect for row in rows)


@register.filter
def unconfirmed(rows: Sequence[Speedup]) -> int:
    """The number of `rows` that are unconfirmed."""
    return confirmation.unconfirmed(rows)


@register.filter
def failures(attempts: ModelOutcomes) -> str:
    """On how many devices a configuration did not finish or lost tracking; "" if none ran it."""
    quorum = settings.FRONTRUNNER_QUORUM
    whose = f"tried from {quorum} networks or more" if quorum > 1 else ""
    return formats.failures(attempts.failing, attempts.losing, attempts.devices, "device", whose)


@register.filter
def session_failures(counts: tuple[int, int, int]) -> str:
    """The same for one device, from the counts of its sessions: all, failed, lost."""
    sessions, failed, lost = counts
    return formats.failures(failed, lost, sessions, "session")


@register.simple_tag
def share(number: int, of: int) -> str:
    """`number` out of `of`."""
    return formats.share(number, of)


@register.filter
def tracked_of(series: RunSeries) -> str:
    """The number of tracked frames of a run, out of those on which tracking was attempted, if reported."""
    tracked, shown = series.run.tracked_frames, tracking(series)
    return formats.count(tracked) if tracked is None or shown is None else formats.share(tracked, shown.tried)


@register.filter
def skipped_in(configuration: str, detail: SessionDetail) -> float | None:
    """The share of the counted frames that the runs of `configuration` left out; None if it computes all."""
    runs = [series for series in detail.runs if series.run.configuration == configuration]
    shares = [series.skipped for series in runs if series.skipped is not None]
    return fmean(shares) if shares else None


@register.filter
def first_counted(protocol: Protocol | None) -> int:
    """The first counted frame, from 0; the usual one before there is a front."""
    return protocol.first_counted_frame if protocol else FIRST_COUNTED_FRAME


@register.filter
def ate_limit(protocol: Protocol | None) -> str:
    """The trajectory error from which on a run is invalid; the usual one before there is a front."""
    return f"{(protocol.max_ate if protocol else VALID_BELOW) * 100:g}{formats.GAP}cm"


@register.filter
def unbroken(sentence: str) -> SafeString:
    """`sentence` with the names of configurations in one piece: a browser may break a line behind a
    hyphen."""
    return mark_safe(formats.NUMBERED.sub(r'<span class="nowrap">\g<0></span>', conditional_escape(sentence)))
