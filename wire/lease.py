"""The lease of an evaluation, as POST /leases answers it."""

from typing import Any

import msgspec

from wire.manifest import Sequence


class Lease(msgspec.Struct, frozen=True):
    """An evaluation, leased for `lease_seconds` after each heartbeat.

    Measure `sequences` in this order. `frames`: to run of each, null for all.
    `perturbation`: seed by which each depth is changed by one unit, 0 for none. A sequence may end early once
    it is certain to be above all values of one of `stop_above` (`ate_max` in metres, `runtime` in seconds a
    frame), and after `stop_after` such sequences run no other. Objectives and stages of the result are those
    of the first `learned_on` sequences. The others are held out: a lost camera there is a result, not a
    failure. `opencl_device`: part of the description of a device of `backend`. A measurement fails after
    `timeout_seconds` for each sequence.

    A user's program has no sequences. Its last line has all `objectives`, and, where `feasible` is given, a
    field of that name, with that text if it is feasible. `stop_above` has limits of these objectives, lower
    ones of those `maximised`. A program that must end gets SIGTERM, and its process group SIGKILL
    `grace_seconds` later.
    """

    id: str
    application: str
    configuration: dict[str, Any]
    frames: int | None
    backend: str
    opencl_device: str
    sequences: tuple[Sequence, ...]
    perturbation: int
    stop_above: tuple[dict[str, float], ...]
    stop_after: int
    learned_on: int
    objectives: tuple[str, ...]
    maximised: tuple[str, ...]
    feasible: tuple[str, str] | None
    lease_seconds: float
    heartbeat_seconds: float
    timeout_seconds: float
    grace_seconds: float
