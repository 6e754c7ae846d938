"""Formats of numbers and units, the same on all pages, charts and cards.

Functions take SI units (seconds, metres, bytes) and return text. None becomes ABSENT.
"""

import math
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import cache

from django.utils.formats import get_format
from django.utils.translation import get_language

from slam.definitions import SYSTEMS

ABSENT = "\N{EM DASH}"
TIMES = "\N{MULTIPLICATION SIGN}"
RANGE = "\N{EN DASH}"
# Between a number and its unit, which stay on one line.
GAP = "\N{NARROW NO-BREAK SPACE}"
_MINUS = "\N{MINUS SIGN}"


def localised(number: str) -> str:
    """`number`, written as in English, with the separators of the active language."""
    return number if number.isdecimal() else number.translate(_separators(get_language()))


@cache
def _separators(language: str | None) -> dict[int, str]:
    point, comma = (get_format(f"{name}_SEPARATOR", language) for name in ("DECIMAL", "THOUSAND"))
    return str.maketrans({".": point, ",": comma})


def significant(value: float, digits: int = 3) -> str:
    """`value` with `digits` significant digits, whole thousands separated, never in exponent form above
    1e-4."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else ABSENT
    # The exponent after rounding: 9.999 becomes 10.0, with one more digit before the point.
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    return localised(f"{value:,.{max(0, digits - 1 - exponent)}f}".replace("-", _MINUS))


def speedup(value: float | None, wide: tuple[float, float] | None = None) -> str:
    """A ratio of times: 9.714 is 9.71 and the multiplication sign. `wide`: the interval in its place."""
    if wide:
        return interval(*wide)
    return ABSENT if value is None else significant(value) + TIMES


def gain(value: float | None, wide: tuple[float, float] | None = None) -> str:
    """A ratio of times in a sentence: "2.00x faster", but "0.90x as fast". `wide` as in `speedup`."""
    if wide:
        return f"{interval(*wide)} as fast"
    if value is None or value >= 1:
        return f"{speedup(value)} faster"
    return f"{speedup(value)} as fast"


def interval(low: float | None, high: float | None) -> str:
    """A confidence interval of speedups, or ABSENT without one."""
    if low is None or high is None:
        return ABSENT
    return f"{significant(low)}{RANGE}{significant(high)}{TIMES}"


def milliseconds(seconds: float | None) -> str:
    """Seconds as milliseconds with three significant digits, not finer than microseconds."""
    if seconds is None:
        return ABSENT
    written = significant(seconds * 1e3) if seconds >= 1e-4 else f"{seconds * 1e3:.3f}"
    return f"{written}{GAP}ms"


def frames_per_second(seconds: float | None) -> str:
    """Seconds per frame as frames per second."""
    return ABSENT if not seconds else f"{significant(1 / seconds)}{GAP}fps"


def centimetres(metres: float | None) -> str:
    """Metres as centimetres with two decimals, as usual for trajectory errors."""
    return ABSENT if metres is None else f"{localised(f'{metres * 100:,.2f}')}{GAP}cm"


def data_size(size: int | None) -> str:
    """Bytes in decimal units: kB, MB, GB."""
    if size is None:
        return ABSENT
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= scale:
            return f"{significant(size / scale)}{GAP}{unit}"
    return f"{size}{GAP}bytes"


def count(value: int | None) -> str:
    """An integer with thousands separators."""
    return ABSENT if value is None else localised(f"{value:,}")


def percent(fraction: float | None) -> str:
    """A fraction as per cent."""
    return ABSENT if fraction is None else f"{significant(fraction * 100, 2)}{GAP}%"


def coefficient(value: float | None) -> str:
    """A correlation coefficient with two decimals; ABSENT for NaN."""
    return ABSENT if value is None or math.isnan(value) else f"{value:.2f}".replace("-", _MINUS)


def change(ratio: float | None) -> str:
    """A ratio of two times as a change: 1.03 is +3.0 %."""
    if ratio is None:
        return ABSENT
    return localised(f"{(ratio - 1) * 100:+.1f}{GAP}%".replace("-", _MINUS))


def frames(number: float) -> str:
    """A number of frames, with a fraction for the last one: 4 frames, 44.2 frames."""
    if math.isclose(number, round(number), rel_tol=1e-6):
        return plural(round(number), "frame")
    return f"{significant(number)}\N{NO-BREAK SPACE}frames"


def plural(number: int, noun: str) -> str:
    """'1 device', '83 devices'; the plural of `noun` must end with s."""
    return f"{number:,}\N{NO-BREAK SPACE}{noun}{'' if number == 1 else 's'}"


def share(number: int, of: int) -> str:
    """'2 of 83'; ABSENT of none."""
    return f"{number:,} of {of:,}" if of else ABSENT


def failures(failed: int, lost: int, of: int, noun: str, whose: str = "") -> str:
    """'did not finish on 2 of 83 devices, lost the camera on 20'; "" of none.

    `noun`: device, session. `whose`: which of them are counted.
    """
    if not of:
        return ""
    where = "in" if noun == "session" else "on"
    every = " ".join(filter(None, [plural(of, noun), whose]))
    return f"did not finish {where} {failed:,} of {every}, lost the camera {where} {lost:,}"


def parameter(value: object) -> str:
    """The value of a parameter: 1e-05, 0.1, 256, yes."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{words(str(name))} {parameter(item)}" for name, item in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(parameter(item) for item in value)
    return ABSENT if value is None else str(value)


def words(name: str) -> str:
    """The name of a field with spaces."""
    return name.replace("_", " ")


NUMBERED = re.compile(r"\b(front|probe)-[0-9]+")


def is_numbered(name: str) -> bool:
    """Whether a configuration only has a number, such as front-03, and no proper name."""
    return NUMBERED.fullmatch(name) is not None


def configuration(name: str, number: int | None = None) -> str:
    """The name of a configuration on pages: `name`, otherwise the `number` of its first measurement."""
    return name or (ABSENT if number is None else f"no.\N{NO-BREAK SPACE}{number:,}")


def application(name: str) -> str:
    """The name of an application for people."""
    return SYSTEMS[name].title if name in SYSTEMS else name


# Names of objectives with units, and the factor from SI units.
OBJECTIVES = {
    "runtime": ("runtime, ms a frame", 1e3),
    "runtime_p95": ("95th percentile of the runtime, ms a frame", 1e3),
    "runtime_max": ("slowest frame, ms", 1e3),
    "runtime_ratio": ("runtime over the default's", 1.0),
    "ate_max": ("maximum trajectory error, cm", 100.0),
    "ate_mean": ("mean trajectory error, cm", 100.0),
    "ate_rmse": ("RMSE of the trajectory, cm", 100.0),
    "ate_rmse_aligned": ("RMSE of the aligned trajectory, cm", 100.0),
    "cpu_seconds": ("CPU time, s", 1.0),
    "peak_memory_bytes": ("peak memory, MB", 1e-6),
}


def objective(name: str) -> str:
    """An objective of explorations with its unit, for charts and tables."""
    return OBJECTIVES.get(name, (words(name), 1.0))[0]


def objectives(names: Sequence[str]) -> str:
    """The objectives `names` in a sentence, without units."""
    told = [objective(name).partition(",")[0] for name in names]
    return " and ".join(filter(None, [", ".join(told[:-1]), *told[-1:]]))


# Names of columns in downloads, with the unit.
_UNIT_COLUMNS = {
    "runtime": "runtime_s",
    "runtime_p95": "runtime_p95_s",
    "runtime_max": "runtime_max_s",
    "ate_max": "ate_max_m",
    "ate_mean": "ate_mean_m",
    "ate_rmse": "ate_rmse_m",
    "ate_rmse_aligned": "ate_rmse_aligned_m",
}


def unit_column(objective: str) -> str:
    """An objective's name as a column of a download: ate_max_m, cpu_seconds."""
    return _UNIT_COLUMNS.get(objective, objective)


# Names of predicting models, by rung of a device map.
MODELS = {
    "power": "power law",
    "stages": "stage model",
    "devices": "devices model",
    "reference": "reference only",
}


def model(rung: str) -> str:
    """The name of a predicting model on pages."""
    return MODELS.get(rung, rung)


def duration(seconds: float | None) -> str:
    """A rounded waiting time: 40 s, 12 min, 3 h 20 min."""
    if seconds is None:
        return ABSENT
    if seconds < 90:
        return f"{max(round(seconds), 1)}{GAP}s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes}{GAP}min"
    return f"{minutes // 60}{GAP}h {minutes % 60}{GAP}min"


def hour(moment: datetime | None) -> str:
    """A public time, rounded down to the hour for privacy."""
    return ABSENT if moment is None else moment.strftime("%Y-%m-%d %H:00 UTC")


def day(moment: datetime | None) -> str:
    """The date of `moment`."""
    return ABSENT if moment is None else moment.strftime("%Y-%m-%d")
