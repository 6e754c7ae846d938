"""A front as a file: the shape of fixtures/fronts/<application>-<version>.json, read strictly."""

import hashlib
from typing import Annotated, Any

import msgspec

from crowd.fronts.selectors import BEST, DEFAULT

NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Name = Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9][a-z0-9_-]*$", max_length=64)]
Digest = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}$")]


class InvalidFrontError(ValueError):
    """A front file that is not one; the message says where and what would be right."""


class Predicted(msgspec.Struct):
    """What the reference device measured: seconds a frame, metres. None where the trajectory was lost."""

    runtime: NonNegative
    ate_max: NonNegative | None
    ate_mean: NonNegative | None


class Point(msgspec.Struct):
    """One configuration of the front."""

    name: Name
    parameters: dict[str, bool | int | float | str]
    predicted: Predicted


class Sequence(msgspec.Struct):
    """Which pack the front was measured on, and clients measure on."""

    name: str
    sha256: Digest


class Protocol(msgspec.Struct):
    """How clients measure. Other members pass to clients as they are."""

    version: Annotated[int, msgspec.Meta(ge=1)]
    warmup_frames: Annotated[int, msgspec.Meta(ge=0)]
    frames: Annotated[int, msgspec.Meta(ge=1, le=10_000)]
    first_counted_frame: Annotated[int, msgspec.Meta(ge=0)]
    order: list[str]
    repeats: Annotated[int, msgspec.Meta(ge=1)]
    rest_seconds: NonNegative


class Content(msgspec.Struct):
    """A whole front."""

    application: Name
    version: Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9][a-z0-9._-]*$", max_length=32)] | int
    protocol: Protocol
    sequence: Sequence
    configurations: list[Point]
    provenance: dict[str, Any]


def check(document: dict[str, Any]) -> Content:
    """DOCUMENT as a front. Raises InvalidFrontError naming the member that is missing or wrong."""
    try:
        content = msgspec.convert(document, Content)
    except msgspec.ValidationError as error:
        raise InvalidFrontError(f"not a front: {error}") from error
    names = [point.name for point in content.configurations]
    protocol = content.protocol
    for wrong, reason in (
        (len(set(names)) < len(names), f"configurations: names repeat in {names}"),
        (
            DEFAULT not in names,
            f"configurations: none is called {DEFAULT}, which every speedup is measured against",
        ),
        (BEST not in names, f"configurations: none is called {BEST}, which clients measure"),
        (not set(protocol.order) <= set(names), f"protocol.order: {protocol.order} names no configuration"),
        (DEFAULT not in protocol.order, f"protocol.order: {DEFAULT} is missing"),
        (
            protocol.first_counted_frame >= protocol.frames,
            f"protocol.first_counted_frame: {protocol.first_counted_frame} is not below {protocol.frames}",
        ),
    ):
        if wrong:
            raise InvalidFrontError(f"not a front: {reason}")
    return content


def digest(document: dict[str, Any]) -> str:
    """sha256 over the canonical JSON of DOCUMENT: the order of members and white space do not matter."""
    return hashlib.sha256(msgspec.json.encode(document, order="sorted")).hexdigest()
