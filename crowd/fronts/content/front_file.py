"""The file format of a front, fixtures/fronts/<application>-<version>.json, and its checks."""

import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec.structs import replace

from crowd.fronts.content.generalisation import Results, objections
from slam.configuration import ConfigurationError
from slam.definitions import SYSTEMS
from wire.front import (
    A_DIGEST,
    A_NAME,
    A_VERSION,
    BEST,
    DEFAULT,
    Content,
    Point,
    Protocol,
    disagreements,
)
from wire.protocol import PAIRS, VERSION

NUMBERS = r"^[0-9]{1,6}(\.[0-9]{1,6}){0,4}$"
REMEDIES = {
    A_NAME: "lower-case letters, digits, - and _, starting with a letter or digit",
    A_VERSION: "lower-case letters, digits, dots, - and _, starting with a letter or digit",
    A_DIGEST: "a sha256 of 64 hexadecimal digits",
}
MISSING = re.compile(r"Object missing required field `(.+)`")
UNKNOWN = re.compile(r"Object contains unknown field `(.*)`", re.DOTALL)
# Three numbers on a line each, in indented JSON. A position is written on one line.
ONE_POSITION = re.compile(r"\[\n\s+(-?\d[^\s,]*),\n\s+(-?\d[^\s,]*),\n\s+(-?\d[^\s,]*)\n\s+\]")
NOT_TEXT = re.compile("[\\x00\\ud800-\\udfff]")
KINDS = ("configurations", "probes")
# What a preparation adds, besides predicted.on_sequence.
PREPARED = ("band", "trajectory", "trajectory_sha256", "skipped", "program", "not_told_apart")
LARGEST_FILE_BYTES = 4 << 20
LARGEST_NUMBER = 2**63 - 1


class InvalidFrontError(ValueError):
    """The front is not valid; the message names the member and the remedy."""


class Prepared(msgspec.Struct):
    """Where, when and how a front was prepared; `left_out`: the points left out, with reasons.

    `variants`: the devices and layouts that ran. `app_version`: the least version of clients that compute the
    same. `renamed`: new names by those in the draft.
    """

    date: str
    device: str
    driver: str
    software: str
    app_version: Annotated[str, msgspec.Meta(pattern=NUMBERS)]
    variants: list[str]
    rounds: int
    left_out: dict[str, str]
    renamed: dict[str, str]


def read(path: Path) -> dict[str, Any]:
    """The document in the JSON file `path`. Raises InvalidFrontError if it cannot be read."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InvalidFrontError(f"{path} cannot be read: {error.strerror}") from error
    try:
        return parse(content)
    except InvalidFrontError as error:
        raise InvalidFrontError(f"{path}: {error}") from error


def parse(content: bytes) -> dict[str, Any]:
    """The document in `content`. Raises InvalidFrontError if it is not a JSON object, or too large."""
    if len(content) > LARGEST_FILE_BYTES:
        raise InvalidFrontError(f"the file is too large: a front has at most {LARGEST_FILE_BYTES} bytes")
    try:
        document = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidFrontError(f"cannot be read as JSON: {error}") from error
    if not isinstance(document, dict):
        raise InvalidFrontError("not a front: the file must hold one JSON object with the front's members")
    return document


def check(document: Mapping[str, Any]) -> Content:
    """`document` as a front that clients can measure.

    Raises InvalidFrontError, which names the missing or wrong member.
    """
    content = check_draft(document)
    for entry, point, member in _missing(content):
        raise InvalidFrontError(
            f"not a front: {entry}.{member} of {point}: is missing: prepare the draft (the button of its "
            f"page, or: frontrunner admin front prepare {content.slug})"
        )
    return content


def check_draft(document: Mapping[str, Any]) -> Content:
    """`document` as a draft, which may lack what its preparation adds.

    Raises InvalidFrontError as `check`.
    """
    try:
        if (reason := _not_storable(document)) is not None:
            raise InvalidFrontError(f"not a front: {reason}")
        _refuse_earlier_protocol(document)
        content = msgspec.convert(_with_text_version(document), Content)
    except msgspec.ValidationError as error:
        raise InvalidFrontError(f"not a front: {_with_place(error)}") from error
    except RecursionError as error:
        raise InvalidFrontError("not a front: it is nested too deeply") from error
    for reason in _mistakes(content):
        raise InvalidFrontError(f"not a front: {reason}")
    return content.with_each(lambda point: replace(point, trajectory_sha256=None, reference_ate=None))


def _with_text_version(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """`document`, whose version may be a whole number."""
    version = document.get("version")
    return {**document, "version": str(version)} if type(version) is int else document


def _refuse_earlier_protocol(document: Mapping[str, Any]) -> None:
    """Raise InvalidFrontError, with the remedy, if `document` is of an earlier version of the protocol."""
    protocol = document.get("protocol")
    version = protocol.get("version") if isinstance(protocol, dict) else None
    if type(version) is int and 0 < version < VERSION:
        slug = f"{document.get('application')}-{document.get('version')}"
        raise InvalidFrontError(
            f"protocol.version: clients no longer measure version {version}: set it to {VERSION} and "
            f"protocol.repeats to {PAIRS} in the front's file, import that as a draft, then: "
            f"frontrunner admin front prepare {slug:.97}"
        )


def document(content: Content) -> dict[str, Any]:
    """`content` as a front file has it."""
    file: dict[str, Any] = msgspec.to_builtins(content)
    return file


def without_preparation(content: Content) -> Content:
    """`content` without what a preparation adds, as a draft that can be prepared."""
    provenance = {name: value for name, value in content.provenance.items() if name != "prepared"}
    stripped = dict.fromkeys(PREPARED) | {"not_told_apart": ()}
    return replace(content, provenance=provenance).with_each(
        lambda point: replace(point, predicted=replace(point.predicted, on_sequence=None), **stripped)
    )


def needs_colour(application: str) -> bool:
    """Whether `application` needs colour; False if it is not known here."""
    return application in SYSTEMS and SYSTEMS[application].colour


def text(content: Content) -> str:
    """`content` as readable JSON."""
    return ONE_POSITION.sub(r"[\1, \2, \3]", json.dumps(document(content), indent=2)) + "\n"


def digest(content: Content) -> str:
    """The sha256 of `content`, with its trajectories, in canonical form: sorted JSON without white space."""
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def _with_place(error: msgspec.ValidationError) -> str:
    """The text of `error`: first the member, then the reason and the remedy."""
    reason, _, path = str(error).replace(" | null`", "`").partition(" - at `")  # what is absent may be null
    member = path.rstrip("`").removeprefix("$").removeprefix(".")
    if missing := MISSING.fullmatch(reason):
        member, reason = f"{member}.{missing[1]}".lstrip("."), "is missing, add it"
    if unknown := UNKNOWN.fullmatch(reason):
        known = ", ".join(Protocol.__struct_fields__)
        member, reason = f"{member}.{unknown[1]:.80}", f"is unknown: a protocol has {known}"
    for pattern, remedy in REMEDIES.items():
        if f"regex {pattern!r}" in reason:
            reason = f"must be {remedy}"
    line = " ".join(f"{member}: {reason}".split())
    return f"{line} (docs/operate/publishing.md shows a whole front)"


def _mistakes(content: Content) -> Iterator[str]:
    """Mistakes that a check of types does not find."""
    protocol, names = content.protocol, [point.name for point in content.configurations]
    every = [point.name for point in content.every]
    if len(set(every)) < len(every):
        yield f"configurations: names repeat in {every}: give each point and probe its own"
    if DEFAULT not in names:
        yield f"configurations: {DEFAULT} is missing: every speedup is measured against it"
    if BEST not in names:
        yield f"configurations: {BEST} is missing: clients measure it"
    if content.sequence.colour_sha256 is None and needs_colour(content.application):
        yield f"sequence.colour_sha256: is missing, add it: {content.application} needs colour"
    yield from (f"protocol.{reason}" for reason in disagreements(protocol, names))
    for kind in KINDS:
        for number, point in enumerate(getattr(content, kind)):
            for member, reason in _point_mistakes(point, content.application, protocol.frames):
                yield f"{kind}[{number}].{member} of {point.name}: {reason}"
    for member in ("sequences", "held_out"):
        if not _is_packs(content.provenance.get(member, [])):
            yield f"provenance.{member}: give a list of {{name, sha256}}"
    if "prepared" in content.provenance:
        try:
            msgspec.convert(content.provenance["prepared"], Prepared)
        except msgspec.ValidationError as error:
            yield f"provenance.prepared: {_with_place(error)}"
    points = {point.name: point for point in content.configurations}
    default, best = points.get(DEFAULT), points.get(BEST)
    if default is not None and best is not None:
        results, beside = (Results(point.learned_on, point.held_out) for point in (best, default))
        for objection in objections(results, beside, protocol.max_ate):
            yield f"configurations: {BEST}: {objection}: choose another"


def _is_packs(value: Any) -> bool:
    """Whether `value` is a list of sequences with name and digest."""
    return isinstance(value, list) and all(
        isinstance(pack, dict) and {"name", "sha256"} <= pack.keys() for pack in value
    )


def _point_mistakes(point: Point, application: str, frames: int) -> Iterator[tuple[str, str]]:
    """The wrong members of `point`, each with the reason."""
    if point.trajectory is not None and len(point.trajectory) != frames:
        yield "trajectory", f"has {len(point.trajectory)} positions: give one for each of the {frames} frames"
    for member in ("learned_on", "held_out"):
        names = [result.sequence for result in getattr(point, member)]
        if len(set(names)) < len(names):
            yield member, f"sequences repeat in {names}: give each one result"
    try:
        # Parameters of unknown applications are not checked.
        if application in SYSTEMS:
            SYSTEMS[application].complete(point.parameters)
    except ConfigurationError as error:
        yield "parameters", str(error)


def _missing(content: Content) -> Iterator[tuple[str, str, str]]:
    """What a preparation has to add: the place and the name of the point, and the member."""
    for kind in KINDS:
        for number, point in enumerate(getattr(content, kind)):
            for member in ("band", "trajectory"):
                if getattr(point, member) is None:
                    yield f"{kind}[{number}]", point.name, member
            if point.predicted.on_sequence is None:
                yield f"{kind}[{number}]", point.name, "predicted.on_sequence"


def _not_storable(value: Any, path: str = "") -> str | None:
    """The first member below `path` that JSON or a database cannot hold, with the reason; None without
    one."""
    if isinstance(value, float) and not math.isfinite(value):
        return f"{path.removeprefix('.')}: must be a finite number"
    if isinstance(value, int) and abs(value) > LARGEST_NUMBER:
        return f"{path.removeprefix('.')}: must be at most {LARGEST_NUMBER}"
    if isinstance(value, str) and NOT_TEXT.search(value):
        return f"{path.removeprefix('.')}: has a character that is not text (NUL or half a surrogate pair)"
    inner: Iterator[tuple[str, Any]] = iter(())
    if isinstance(value, dict):
        if (name := next(filter(NOT_TEXT.search, value), None)) is not None:
            return f"{path.removeprefix('.')}: the name {ascii(name)[:80]} has a character that is not text"
        inner = ((f"{path}.{name}", member) for name, member in value.items())
    elif isinstance(value, list):
        inner = ((f"{path}[{number}]", member) for number, member in enumerate(value))
    return next((why for name, member in inner if (why := _not_storable(member, name)) is not None), None)
