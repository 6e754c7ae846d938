"""The lease of an evaluation: what a machine asks for, gets, and answers."""

from typing import Annotated, Any, Literal

import msgspec

from wire.evaluation import Outcome, Text
from wire.manifest import Sequence

# Machines measure several sequences, perturb depth, stop early and send the parts of a result.
LEASE_VERSION = 2


class LeaseRequest(msgspec.Struct, frozen=True):
    """A request for work: the expected reference device, and a name of the worker for people.

    `lease_version` must be 2: the client measures all `sequences` of a lease, respects `perturbation`,
    `stop_above` and `stop_after`, and sends the `parts` of its result.
    """

    device: Text | None = None
    worker: Text = ""
    lease_version: int = 1


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


class Result(Outcome, frozen=True, omit_defaults=True):
    """The result of an evaluation.

    `done` needs `objectives` (seconds per frame, metres), `stages` (mean seconds per frame), `device` and
    `parts`, the objectives of each sequence that was run; of a program `values` instead. Of a program that
    ended early, `stopped_at` counts its reports so far, and `censored` names the values that are bounds: the
    final ones are these or worse. `failed` needs an `error`. `returned` lets another machine measure it;
    `error` may say why this one cannot. Send the `configuration` of the lease, so that a result is never
    stored for another evaluation.
    """

    status: Literal["done", "failed", "returned"]
    values: Annotated[dict[Text, float], msgspec.Meta(max_length=64)] | None = None
    stopped_at: Annotated[int, msgspec.Meta(ge=1)] | None = None
    configuration: dict[str, Any] | None = None


class Held(msgspec.Struct, frozen=True):
    """The lease is valid for this long from now."""

    lease_seconds: float


class Stored(msgspec.Struct, frozen=True):
    """The new state of the evaluation."""

    state: str
