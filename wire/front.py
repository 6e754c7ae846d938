"""A front: what a front file holds, what the database keeps of it, and what every reader of it gets.

`Content` is declared once: files are checked against it, its canonical JSON has the digest, and a row of the
database is that JSON, in which each trajectory is named by its digest.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any

import msgspec

from wire.protocol import MOST_RUNS, VALID_BELOW, VERSION

DEFAULT = "default"
BEST = "best"
ADAPTIVE = "adaptive"  # the fastest that leaves out frames, which every client measures, too

MAX_FRAMES = 10_000
WITHIN_AN_HOUR = msgspec.Meta(ge=0, le=3600)  # seconds

A_NAME, A_VERSION = r"^[a-z0-9][a-z0-9_-]*$", r"^[a-z0-9][a-z0-9._-]*$"
A_DIGEST = r"^[0-9a-f]{64}$(?!\n)"  # it becomes the name of a file
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Positive = Annotated[float, msgspec.Meta(gt=0)]
Metres = Annotated[float, msgspec.Meta(gt=0, le=10)]
Share = Annotated[float, msgspec.Meta(ge=0, lt=1)]
Count = Annotated[int, msgspec.Meta(ge=0)]
Name = Annotated[str, msgspec.Meta(pattern=A_NAME, max_length=64)]
Digest = Annotated[str, msgspec.Meta(pattern=A_DIGEST)]
FrameNumber = Annotated[int, msgspec.Meta(ge=0, le=MAX_FRAMES)]
Positions = tuple[tuple[float, float, float], ...]  # of each frame, in metres in the volume's frame


class Protocol(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How clients measure. Times are seconds, `max_ate` metres, frames are counted from 0.

    A new version of the protocol adds its members here.
    """

    version: Annotated[int, msgspec.Meta(ge=1)]
    warmup_frames: FrameNumber
    frames: Annotated[int, msgspec.Meta(ge=1, le=MAX_FRAMES)]
    first_counted_frame: FrameNumber
    order: Annotated[tuple[str, ...], msgspec.Meta(min_length=2, max_length=MOST_RUNS)]
    repeats: Annotated[int, msgspec.Meta(ge=1, le=MOST_RUNS)]
    rest_seconds: Annotated[int, WITHIN_AN_HOUR] | Annotated[float, WITHIN_AN_HOUR]
    max_ate: Metres = VALID_BELOW


def disagreements(protocol: Protocol, configurations: Collection[str]) -> Iterator[str]:
    """Inconsistencies of `protocol`, with itself or with the names of the front's `configurations`."""
    if protocol.version > VERSION:
        yield f"version: {protocol.version} is unknown here: this program measures by version {VERSION}"
    if protocol.first_counted_frame >= protocol.frames:
        yield f"first_counted_frame: {protocol.first_counted_frame} is not below frames ({protocol.frames})"
    counts = Counter(protocol.order)
    if unknown := [name for name in counts if name not in configurations]:
        yield (
            f"order: {unknown[0]!r:.80} is not a configuration of this front: choose from "
            f"{', '.join(configurations)}"
        )
    if DEFAULT not in counts:
        yield f"order: {DEFAULT} is missing: every speedup is measured against it"
    if len(counts) == 1:
        yield f"order: it only names {DEFAULT}: add a configuration to compare with it"
    if len(set(counts.values())) > 1:
        yield f"order: each configuration must appear equally often, not {dict(counts)}"
        return
    each = counts.most_common(1)[0][1]
    if protocol.repeats % each:
        yield f"repeats: order names each configuration {each} times: give {each} or a multiple of it"
    if (runs := protocol.repeats * len(counts)) > MOST_RUNS:
        yield f"repeats: {protocol.repeats} of {len(counts)} names are {runs} runs: give at most {MOST_RUNS}"


class OnSequence(msgspec.Struct, frozen=True, omit_defaults=True):
    """Ratios to the runtime of the default in the same round, on the sequence that clients measure.

    `runtime_ratio` of a frame; `stages`: those of each stage. `low` to `high`: the 95 % interval of
    `runtime_ratio`, from so many `rounds`. `processor_ratio`: by processor time; None where it is unknown.
    """

    runtime_ratio: Positive
    stages: dict[str, NonNegative]
    low: Positive
    high: Positive
    rounds: Annotated[int, msgspec.Meta(ge=1)]
    processor_ratio: Positive | None = None


class Predicted(msgspec.Struct, frozen=True, omit_defaults=True):
    """Measurements of the reference device: seconds per frame, metres. Errors are None if tracking was lost.

    `runtime_ratio`, if known, is the ratio to the runtime of the default in the same round. The other ends of
    both are 95 % intervals from so many `measurements`. `on_sequence`: the same on the sequence that clients
    measure.
    """

    runtime: NonNegative
    ate_max: NonNegative | None
    ate_mean: NonNegative | None
    runtime_ratio: NonNegative | None = None
    runtime_low: NonNegative | None = None
    runtime_ratio_low: NonNegative | None = None
    runtime_high: NonNegative | None = None
    runtime_ratio_high: NonNegative | None = None
    measurements: Count | None = None
    on_sequence: OnSequence | None = None

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of the speedup on the clients' sequence; None before the preparation."""
        return None if self.on_sequence is None else (1 / self.on_sequence.high, 1 / self.on_sequence.low)


def predicted_speedup(default: Predicted | None, own: Predicted) -> float | None:
    """The predicted speedup over `default`; None if a runtime is unknown.

    That on the clients' sequence, once it was prepared. Before, ratios to the default of the same round are
    used if both are known, because they do not depend on varying load of the host.
    """
    if own.on_sequence is not None:
        return 1 / own.on_sequence.runtime_ratio
    if default is None:
        return None
    before, after = default.runtime_ratio, own.runtime_ratio
    if before is None or after is None:
        before, after = default.runtime, own.runtime
    return before / after if before and after else None


class SequenceResult(msgspec.Struct, frozen=True):
    """The largest error (m) and the most lost frames of all measurements on one sequence."""

    sequence: str
    ate_max: NonNegative
    lost: Count


class Errors(msgspec.Struct, frozen=True):
    """Distances (m) of a trajectory from the truth, once its first pose was laid on the first true one."""

    ate_max: NonNegative
    ate_mean: NonNegative
    ate_rmse: NonNegative


class Point(msgspec.Struct, frozen=True, omit_defaults=True):
    """A configuration of the front, or a probe. A draft may lack what its preparation adds.

    `band`: the allowed distance (m) from the reference `trajectory`, which a file has, and of which the
    database has the digest. `reference_ate`: the errors of that trajectory on the clients' sequence; only the
    database has them, where the true poses are known. `skipped`: the share of the counted frames that it left
    out then; None for a configuration that computes every frame. `program`: the digest of the plan and
    shaders that made them, for a system that has plans. `not_told_apart`: other points that may be as fast.
    `learned_on` and `held_out`: results on sequences that the search used, and that it never saw.
    """

    name: Name
    parameters: dict[str, bool | int | float | str]
    predicted: Predicted
    band: Metres | None = None
    trajectory: Positions | None = None
    trajectory_sha256: Digest | None = None
    reference_ate: Errors | None = None
    skipped: Share | None = None
    program: Digest | None = None
    not_told_apart: tuple[Name, ...] = ()
    learned_on: tuple[SequenceResult, ...] = ()
    held_out: tuple[SequenceResult, ...] = ()

    @property
    def runtime(self) -> float:
        """Seconds per frame on the reference device."""
        return self.predicted.runtime

    @property
    def ate_max(self) -> float | None:
        """The largest error (m) on the sequences learned on, as predicted, or as measured where that is
        larger; None if tracking was lost. Limits apply to it."""
        if (predicted := self.predicted.ate_max) is None:
            return None
        return max([predicted, *(result.ate_max for result in self.learned_on)])

    @property
    def held_out_ate_max(self) -> float | None:
        """The largest error (m) on the held-out sequences. None where it was not measured on any."""
        return max((result.ate_max for result in self.held_out), default=None)


class PackName(msgspec.Struct, frozen=True, omit_defaults=True):
    """The pack that the front was measured on, and that clients measure; with its colour if needed."""

    name: str
    sha256: Digest
    colour_sha256: Digest | None = None


class Content(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a front consists of. `probes` are further configurations that clients measure only if they are
    asked to."""

    application: Name
    version: Annotated[str, msgspec.Meta(pattern=A_VERSION, max_length=32)]
    protocol: Protocol
    sequence: PackName
    configurations: tuple[Point, ...]
    provenance: dict[str, Any]
    probes: tuple[Point, ...] = ()

    @property
    def slug(self) -> str:
        """Its name in every address."""
        return f"{self.application}-{self.version}"

    @property
    def every(self) -> tuple[Point, ...]:
        """Its points, then its probes."""
        return (*self.configurations, *self.probes)

    def with_each(self, change: Callable[[Point], Point]) -> "Content":
        """The same with `change` of each point and probe."""
        points, probes = (tuple(map(change, each)) for each in (self.configurations, self.probes))
        return msgspec.structs.replace(self, configurations=points, probes=probes)


def decoded(document: str) -> Content:
    """The content in a `document` of the database."""
    return msgspec.json.decode(document, type=Content)


@dataclass(frozen=True)
class Front:
    """A front of the database; `published_at` is None before its publication.

    `sequence` is the description of its pack, as clients download it.
    """

    state: str
    digest: str
    published_at: datetime | None
    sequence: dict[str, Any]
    content: Content

    @property
    def slug(self) -> str:
        return self.content.slug

    @property
    def application(self) -> str:
        return self.content.application

    @property
    def version(self) -> str:
        return self.content.version

    @property
    def protocol(self) -> Protocol:
        return self.content.protocol

    @property
    def provenance(self) -> dict[str, Any]:
        return self.content.provenance

    @property
    def points(self) -> tuple[Point, ...]:
        """Its points in published order."""
        return self.content.configurations

    @property
    def probes(self) -> tuple[Point, ...]:
        return self.content.probes

    def point(self, name: str) -> Point | None:
        """The configuration `name`, or None."""
        return next((point for point in self.points if point.name == name), None)

    @property
    def sequence_names(self) -> tuple[list[str], list[str]]:
        """The sequences with results that it was learned on (else that of clients), and the held-out ones."""
        learned, held_out = (
            list(dict.fromkeys(one.sequence for point in self.points for one in getattr(point, kind)))
            for kind in ("learned_on", "held_out")
        )
        return learned or [self.sequence["name"]], held_out
