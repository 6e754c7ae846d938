"""Types of command-line arguments."""

from __future__ import annotations

import argparse
import json
import math
import os
from pathlib import Path
from typing import Any

from slam.stopping import CONDITIONED

PYRAMID = ("pyramid_iterations_fine", "pyramid_iterations_middle", "pyramid_iterations_coarse")


class UsageError(ValueError):
    """An argument with an impossible value."""


def number(text: str) -> float:
    """A finite number; argparse reports the ValueError."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def numbers(text: str, count: int) -> tuple[float, ...]:
    values = tuple(number(item) for item in text.split(","))
    if len(values) != count:
        raise argparse.ArgumentTypeError(f"{text!r}: give {count} numbers with commas between them")
    return values


def three_numbers(text: str) -> tuple[float, ...]:
    return numbers(text, 3)


def four_numbers(text: str) -> tuple[float, ...]:
    return numbers(text, 4)


def setting(text: str) -> dict[str, Any]:
    """`name=value`, or a JSON object of several, as a mapping.

    null leaves a parameter at its default. pyramid_iterations=fine,middle,coarse is short for the three.
    """
    if text.lstrip().startswith("{"):
        return _object(text)
    name, separator, value = text.partition("=")
    if not separator:
        raise argparse.ArgumentTypeError(f"{text!r}: write name=value")
    if name == "pyramid_iterations":
        return dict(zip(PYRAMID, map(_parameter, _three(value, text)), strict=True))
    return {name: _parameter(value)}


def _object(text: str) -> dict[str, Any]:
    try:
        read = json.loads(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not JSON: {error}") from None
    return {name: value for name, value in read.items() if value is not None}


def _three(value: str, text: str) -> list[str]:
    items = value.split(",")
    if len(items) != len(PYRAMID):
        raise argparse.ArgumentTypeError(f"{text!r}: write pyramid_iterations=fine,middle,coarse")
    return items


def _parameter(text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return number(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def condition(text: str) -> dict[str, float]:
    """`name=value`, or several with commas between them, as a mapping; the names are CONDITIONED."""
    read = {}
    for item in text.split(","):
        name, _, value = item.partition("=")
        if name not in CONDITIONED:
            raise argparse.ArgumentTypeError(
                f"{text!r}: write {' or '.join(CONDITIONED)}=value, as in ate_max=0.05"
            )
        read[name] = number(value)
    return read


def values(text: str) -> tuple[float, ...]:
    """Different numbers with commas between them, ascending."""
    return tuple(sorted({_parameter(item) for item in text.split(",")}))


def writable(path: Path | None) -> None:
    """Raise UsageError, before long work, when a file cannot be written there."""
    if path is None:
        return
    if path.is_dir():
        raise UsageError(f"{path} cannot be written: it is a folder")
    if not path.parent.is_dir():
        raise UsageError(f"{path} cannot be written: there is no folder {path.parent}")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise UsageError(f"{path} cannot be written: permission denied")
