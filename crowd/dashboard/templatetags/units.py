"""Template filters over crowd.dashboard.formats: every number on a page passes through one of them."""

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from functools import wraps
from typing import Any

from django import template
from django.utils.html import conditional_escape
from django.utils.safestring import SafeString, mark_safe

from crowd.dashboard import confirmation, formats
from crowd.dashboard.content.parameter_meanings import meaning_of
from crowd.dashboard.content.stages import tracking
from crowd.fronts.content.protocol import first_counted_frame, max_ate
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.rows import Device, ModelOutcomes, RunSeries, Speedup
from crowd.results.validity.rules import RULES
from slam.protocol import MAX_DRIFT
from slam.public_text import without_folders

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
    "application": formats.application,
    "model": formats.model,
    "duration": formats.duration,
    "public": without_folders,
    "hour": formats.hour,
    "day": formats.day,
}


def _defined(function: Callable[..., str]) -> Callable[..., str]:
    """FUNCTION with None for a variable that a template does not have, which Django hands on as ""."""

    @wraps(function)
    def formatted(value: Any, *arguments: Any) -> str:
        return function(None if value == "" else value, *arguments)

    return formatted


for name, function in FORMATS.items():
    register.filter(name, _defined(function))


@register.simple_tag
def interval(low: float | str | None, high: float | str | None) -> str:
    """Both ends of a confidence interval of speedups; "" is what a template hands on of no figure."""
    return formats.interval(None if isinstance(low, str) else low, None if isinstance(high, str) else high)


@register.simple_tag
def max_drift() -> str:
    """How much slower a repeat may be before its session is suspect."""
    return formats.change(MAX_DRIFT)


@register.filter
def at_least(text: str, censored: bool) -> str:
    """TEXT, an error, as a lower bound where the measurement ended before all sequences were run."""
    return f"at least {text}" if censored else text


@register.filter
def since(moment: datetime | None, now: datetime) -> str:
    """How long ago MOMENT was."""
    return formats.duration((now - moment).total_seconds() if moment else None)


@register.filter
def or_absent(text: str | None) -> str:
    """TEXT, or the sign for what is not known."""
    return text or formats.ABSENT


@register.filter
def backend(name: str) -> str:
    """NAME of a backend as people write it."""
    return BACKENDS.get(name, name)


@register.filter
def value(mapping: Mapping[str, Any], key: str) -> Any:
    """MAPPING's item KEY, None where it has none: templates cannot look up by a variable."""
    return mapping.get(key)


@register.filter
def pack_size(sequence: Mapping[str, Any]) -> int:
    """Bytes that a client downloads for a front's sequence, with its colour where that is needed."""
    colour = sequence.get("colour") or {}
    return sum(chunk["bytes"] for pack in (sequence, colour) for chunk in pack.get("chunks", ()))


@register.filter
def rule(code: str) -> str:
    """The rule behind a state's reason, in a sentence; the code itself where no sentence is known."""
    return RULES[code].words if code in RULES else code


@register.filter
def device_text(device: Any) -> str:
    """A provenance's device in one line: its name, where it is described by several fields."""
    if isinstance(device, Mapping):
        return str(device.get("name") or formats.parameter(device))
    return str(device or "")


@register.filter
def parts(device: Device) -> str:
    """What a device consists of, as far as it is known."""
    known = dict.fromkeys(part for part in (device.gpu, device.soc, device.cpu, device.os) if part)
    return ", ".join(known) or "Its parts are not known."


@register.filter
def suspects(rows: Sequence[Speedup]) -> int:
    """How many of ROWS rest on suspect sessions alone."""
    return sum(row.suspect for row in rows)


@register.filter
def unconfirmed(rows: Sequence[Speedup]) -> int:
    """How many of ROWS wait for confirmation."""
    return confirmation.unconfirmed(rows)


@register.filter
def failures(attempts: ModelOutcomes) -> str:
    """On how many devices a configuration did not finish or lost the camera; "" where none ran it."""
    return formats.failures(attempts.failing, attempts.losing, attempts.devices, "device")


@register.filter
def session_failures(counts: tuple[int, int, int]) -> str:
    """The same of one device, from the counts of its sessions: all, failed, lost."""
    sessions, failed, lost = counts
    return formats.failures(failed, lost, sessions, "session")


@register.simple_tag
def share(number: int, of: int) -> str:
    """A count out of another one."""
    return formats.share(number, of)


@register.filter
def tracked_of(series: RunSeries) -> str:
    """On how many frames a run tracked the camera, of those on which it tried; the first number alone where
    the client did not tell the second.
    """
    tracked, shown = series.run.tracked_frames, tracking(series)
    return formats.count(tracked) if tracked is None or shown is None else formats.share(tracked, shown.tried)


@register.filter
def first_counted(protocol: Mapping[str, Any]) -> int:
    """The first frame that the statistics count, from 0."""
    return first_counted_frame(protocol)


@register.filter
def ate_limit(protocol: Mapping[str, Any]) -> str:
    """The trajectory error from which on a run is invalid."""
    return f"{max_ate(protocol) * 100:g}{formats.GAP}cm"


@register.filter
def sessions(rows: Sequence[Speedup]) -> int:
    """How many sessions stand behind ROWS."""
    return sum(row.sessions for row in rows)


@register.filter
def unbroken(sentence: str) -> SafeString:
    """SENTENCE with the names of configurations in one piece: a browser may break a line behind a hyphen."""
    return mark_safe(formats.NUMBERED.sub(r'<span class="nowrap">\g<0></span>', conditional_escape(sentence)))
