"""What to use on a device, as GET /recommendation answers it."""

from typing import Any

import msgspec

from wire.front import Positive


class Ratio(msgspec.Struct, frozen=True):
    """How many times faster than the default, with its 95 % interval."""

    ratio: Positive
    low: Positive
    high: Positive


class Basis(msgspec.Struct, frozen=True):
    """The basis of a prediction: the model, its training data and the most similar devices.

    `rung`: the model; `reference`: only the reference device. `sessions`, `devices`: how many it learned
    from.
    """

    rung: str
    sessions: int
    devices: int
    nearest: list[str]


class Point(msgspec.Struct, frozen=True):
    """A configuration on this device: its error (m; null where unknown) and ratio to the default.

    `ate_max`: the largest on the sequences learned on, or on this device. `held_out_ate_max`: the largest on
    the held-out sequences; null without one.
    `skipped`: the share of the frames that it left out on the reference; absent if it computes all.
    """

    configuration: str
    parameters: dict[str, Any]
    ate_max: float | None
    held_out_ate_max: float | None
    ratio: Positive
    low: Positive
    high: Positive
    state: str
    skipped: float | msgspec.UnsetType = msgspec.UNSET


class SequenceNames(msgspec.Struct, frozen=True):
    """The sequences that a front was learned on, and those that it was only checked on."""

    learned_on: list[str]
    held_out: list[str]


class Recommendation(msgspec.Struct, frozen=True):
    """The configuration to use on a device. `state`: predicted, or measured on that device.

    `ate_max` (m), which the limit applies to: the largest error on the sequences learned on, or on this
    device. `held_out_ate_max`: the largest on the held-out `sequences`; null without one.
    `default_seconds`: time per frame of the default; null if it is unknown. `front`: all points of the front
    on this device.
    """

    application: str
    front_version: str
    about: str
    configuration: str
    parameters: dict[str, Any]
    predicted: Ratio
    ate_max: float | None
    held_out_ate_max: float | None
    sequences: SequenceNames
    default_seconds: float | None
    basis: Basis
    state: str
    front: tuple[Point, ...]
