"""A whole exploration as it travels between servers: fixtures/explorations/<name>.json.gz.

By the names of the database's columns: a further one is one more line. Only finished evaluations travel.
"""

import hashlib
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec

from wire.evaluation import Count, EvaluationRow, Moment, Scalar, SmallCount
from wire.meaning import means

FORMAT, VERSION = "frontrunner-exploration", 1
MAX_ROWS = 1_000_000
SHORT = msgspec.Meta(min_length=1, max_length=200)
DIGEST = msgspec.Meta(pattern="^[0-9a-f]{64}$")


class Pack(msgspec.Struct):
    """A sequence by its name and digest."""

    name: Annotated[str, SHORT]
    sha256: Annotated[str, DIGEST]


class Settings(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What an exploration searches; `prepares` is the name of the front that it prepared."""

    application: Annotated[str, SHORT, means("such as kfusion")]
    sequence: Annotated[str, SHORT, means("the sequence that is measured")]
    method: Annotated[str, SHORT, means("how configurations are chosen")]
    seed: Annotated[Count, means("seed of its random numbers")] = 0
    budget: Annotated[Count, means("most evaluations")]
    created_at: Annotated[Moment, means("when it was made")]
    space: Annotated[dict[str, Any], means("parameters, constraints and conditions")]
    sequence_sha256: Annotated[str, DIGEST, means("SHA-256 of the pack that is measured")]
    error_quantile: Annotated[float, means("which error over the sequences counts; 1: the worst")] = 1.0
    objectives: Annotated[list[str], means("what is minimised: seconds a frame, metres")]
    limits: Annotated[dict[str, float], means("upper bounds by objective")] = {}
    frames: Annotated[Count | None, means("frames that are run; null for all")] = None
    command: Annotated[
        str, msgspec.Meta(max_length=10_000), means("the command line that created it, if one did")
    ] = ""
    further_sequences: list[Pack] = []
    held_out_sequences: list[Pack] = []
    options: dict[str, Scalar] = {}
    synchronous: bool = True
    recheck: bool = True
    batch: SmallCount
    points: SmallCount
    repeats: SmallCount
    prepares: str = ""
    prepares_digest: str = ""


class Document(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A whole exploration, measured by `reference_device` on `machine`.

    `sha256` is the digest of `exploration` and `evaluations`: neither the state nor the machine changes it.
    """

    format: str = FORMAT
    version: int = VERSION
    sha256: Annotated[str, DIGEST]
    machine: Annotated[str, SHORT]
    reference_device: Annotated[str, msgspec.Meta(pattern="^[a-z0-9][a-z0-9_-]*$", max_length=64)]
    state: Literal["done", "cancelled"]
    finished_at: Moment | None = None
    exploration: Settings
    evaluations: Annotated[list[EvaluationRow], msgspec.Meta(min_length=1, max_length=MAX_ROWS)]


def digest(settings: Settings, evaluations: Sequence[EvaluationRow]) -> str:
    """SHA-256 of an exploration's content, which identifies it on every server."""
    content = {"exploration": settings, "evaluations": evaluations}
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()
