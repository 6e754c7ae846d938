"""The file format of a whole exploration, fixtures/explorations/<name>.json.gz, and its checks.

The structs `Settings` and `Row` list what travels, by the names of the models' fields: a further column is
one more line. Only finished evaluations travel. Workers' hosts and folders in texts do not.
"""

import gzip
import hashlib
import socket
import zlib
from collections.abc import Iterable, Iterator
from datetime import datetime
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from django.core.exceptions import ValidationError

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching.batches import configuration_digest
from crowd.explorations.searching.search import CHOSEN_ONCE, FINISHED, search_space, space_index
from crowd.records.evaluation import Part as AnyPart
from slam.public_text import without_folders

FORMAT, VERSION = "frontrunner-exploration", 1
LARGEST_FILE_BYTES = 64 << 20  # unpacked
MAX_ROWS = 1_000_000
T = TypeVar("T")

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
Text = Annotated[str, msgspec.Meta(max_length=10_000)]
Digest = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
Moment = Annotated[datetime, msgspec.Meta(tz=True)]
Count = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]
SmallCount = Annotated[int, msgspec.Meta(ge=0, le=2**15 - 1)]
Position = Annotated[list[float], msgspec.Meta(min_length=3, max_length=3)]
Quantities = dict[str, float]  # SI units
Scalar = bool | int | float | str


class InvalidExplorationError(ValueError):
    """The file is not a valid exploration; the message names the member and the remedy."""


class Pack(msgspec.Struct, forbid_unknown_fields=True):
    """A sequence by its name and digest."""

    name: Name
    sha256: Digest


class Part(AnyPart, forbid_unknown_fields=True):
    """The result on one sequence: objectives, lost frames, and after how many it ended early."""

    sequence: Name
    lost: Count
    objectives: Quantities
    stopped_at: Count | None = None


class Reference(msgspec.Struct, forbid_unknown_fields=True):
    """What the devices of one machine say of a front's point: metres, and the digest of the program."""

    trajectory: list[Position]
    band: float
    largest_deviation: float
    variants: list[Name]
    program: Digest | None = None


class Settings(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The fields of an Exploration that travel; `prepares` is the name of the front that it prepared."""

    application: Name
    space: dict[str, Any]
    sequence: Name
    sequence_sha256: Digest
    further_sequences: list[Pack] = []
    held_out_sequences: list[Pack] = []
    error_quantile: float = 1.0
    objectives: list[Name]
    limits: Quantities = {}
    method: Name
    options: dict[str, Scalar] = {}
    seed: Count = 0
    frames: Count | None = None
    synchronous: bool = True
    recheck: bool = True
    budget: Count
    batch: SmallCount
    points: SmallCount
    repeats: SmallCount
    command: Text = ""
    prepares: str = ""
    prepares_digest: str = ""
    created_at: Moment


class Row(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The fields of an Evaluation that travel. `parts` have their objectives in a member of their own."""

    number: Count
    phase: Name
    label: str = ""
    state: Literal["done", "failed"] = "done"
    configuration: dict[str, Scalar]
    iteration: Count = 0
    frames: Count | None = None
    attempt: Count = 1
    losses: SmallCount = 0
    perturbation: SmallCount = 0
    objectives: Quantities | None = None
    parts: list[Part] | None = None
    censored: list[Name] = []
    ratio_filled_at: Moment | None = None
    stages: Quantities | None = None
    device: dict[str, str | float | bool | None] | None = None
    reference: Reference | None = None
    software: Annotated[str, msgspec.Meta(max_length=64)] = ""
    error: Text = ""
    started_at: Moment | None = None
    finished_at: Moment


class Document(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A whole exploration, measured by `reference_device` on `machine`.

    `sha256` is the digest of `exploration` and `evaluations`: neither the state nor the machine changes it.
    """

    format: str = FORMAT
    version: int = VERSION
    sha256: Digest
    machine: Name
    reference_device: Annotated[str, msgspec.Meta(pattern="^[a-z0-9][a-z0-9_-]*$", max_length=64)]
    state: Literal["done", "cancelled"]
    finished_at: Moment | None = None
    exploration: Settings
    evaluations: Annotated[list[Row], msgspec.Meta(min_length=1, max_length=MAX_ROWS)]


class _Header(msgspec.Struct):
    format: Any = None
    version: Any = None


def digest(exploration: Exploration, evaluations: Iterable[Evaluation]) -> str:
    """The digest of `exploration` with its finished `evaluations`, as its file names it."""
    return _digest(_settings(exploration), _rows(evaluations))


def document(exploration: Exploration, machine: str = "") -> Document:
    """`exploration` as it is now. `machine`: the name of the machine that measured it, by default this
    host's.

    One that is not finished is exported as cancelled. One that was imported keeps the name of its machine.
    Raises InvalidExplorationError if nothing was measured yet.
    """
    device = exploration.reference_device
    settings, rows = _settings(exploration), _rows(exploration.evaluations.all())
    if not rows:
        raise InvalidExplorationError(f"{exploration} has no finished evaluation yet: export it later")
    done = exploration.state == Exploration.State.DONE
    return Document(
        sha256=_digest(settings, rows),
        machine=device.elsewhere or machine or socket.gethostname(),
        reference_device=device.name,
        state="done" if done else "cancelled",
        finished_at=exploration.finished_at,
        exploration=settings,
        evaluations=rows,
    )


def pack(whole: Document) -> bytes:
    """`whole` as the content of a file. Equal documents have equal files."""
    return gzip.compress(msgspec.json.encode(whole, order="sorted"), mtime=0)


def parse(content: bytes) -> Document:
    """The checked document in `content`, a file. Raises InvalidExplorationError."""
    unpacked = _unpack(content)
    if b"\\u0000" in unpacked:
        raise InvalidExplorationError("a text contains the character NUL (\\u0000): remove it")
    header = _decode(unpacked, _Header)
    if header.format != FORMAT:
        raise InvalidExplorationError(
            f"format: is {header.format!r:.80}, not {FORMAT!r}: give a file that `manage.py exploration "
            "export KEY --out FILE.json.gz` wrote"
        )
    if header.version != VERSION:
        raise InvalidExplorationError(
            f"version: is {header.version!r:.80}, and this program reads {VERSION}: export it with this "
            "version of the program, or update the program"
        )
    whole = _decode(unpacked, Document)
    if (actual := _digest(whole.exploration, whole.evaluations)) != whole.sha256:
        raise InvalidExplorationError(
            f"sha256: the content has the digest {actual[:12]}..., not {whole.sha256[:12]}...: it was "
            "changed or damaged, export it again"
        )
    for reason in _mistakes(whole):
        raise InvalidExplorationError(f"{reason}: correct the exploration, or export it again")
    return whole


def unsaved_exploration(whole: Document) -> Exploration:
    """The exploration of `whole` without its device and its front. Raises InvalidExplorationError."""
    exploration = Exploration(
        **_fields(whole.exploration, "prepares"),
        state=whole.state,
        finished_at=whole.finished_at,
        sha256=whole.sha256,
    )
    try:
        exploration.full_clean(exclude={"reference_device", "prepares"})
    except ValidationError as error:
        raise InvalidExplorationError(_first_mistake(error, "exploration")) from error
    return exploration


def unsaved_evaluations(whole: Document, exploration: Exploration) -> Iterator[Evaluation]:
    """The evaluations of `whole` for `exploration`. Raises InvalidExplorationError."""
    space = search_space(exploration)
    for number, row in enumerate(whole.evaluations):
        parts = [part.stored for part in row.parts or ()]
        evaluation = Evaluation(
            exploration=exploration,
            parts=parts or None,
            index=space_index(space, row.configuration),
            configuration_key=configuration_digest(row.configuration),
            **_fields(row, "parts"),
        )
        try:
            evaluation.clean_fields(exclude={"exploration", "index"})
        except ValidationError as error:
            raise InvalidExplorationError(_first_mistake(error, f"evaluations[{number}]")) from error
        yield evaluation


def _settings(exploration: Exploration) -> Settings:
    front = exploration.prepares
    changes = {
        "prepares": "" if front is None else front.slug,
        "command": without_folders(exploration.command),
    }
    return _converted(exploration, Settings, changes)


def _rows(evaluations: Iterable[Evaluation]) -> list[Row]:
    """The finished ones of `evaluations` in the order of their numbers."""
    finished = sorted((row for row in evaluations if row.state in FINISHED), key=lambda row: row.number)
    return [_row(evaluation) for evaluation in finished]


def _row(evaluation: Evaluation) -> Row:
    parts = evaluation.parts and list(map(Part.of, evaluation.parts))
    return _converted(evaluation, Row, {"parts": parts, "error": without_folders(evaluation.error)})


def _converted(row: Any, kind: type[T], changes: dict[str, Any]) -> T:
    """The fields of `row` as `kind`, with `changes` instead of some."""
    names: tuple[str, ...] = kind.__struct_fields__  # type: ignore[attr-defined]
    return msgspec.convert(
        {name: changes[name] if name in changes else getattr(row, name) for name in names}, kind
    )


def _fields(struct: msgspec.Struct, *without: str) -> dict[str, Any]:
    """The fields of a model from `struct`, except those named."""
    names = [name for name in struct.__struct_fields__ if name not in without]
    return {name: msgspec.to_builtins(getattr(struct, name), builtin_types=[datetime]) for name in names}


def _digest(settings: Settings, rows: list[Row]) -> str:
    content = {"exploration": settings, "evaluations": rows}
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def _unpack(content: bytes) -> bytes:
    """`content`, a gzip file, unpacked. Raises InvalidExplorationError."""
    reader = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)
    try:
        unpacked = reader.decompress(content, LARGEST_FILE_BYTES)
    except zlib.error as error:
        raise InvalidExplorationError(f"cannot be unpacked ({error}): give a FILE.json.gz") from error
    if reader.unconsumed_tail:
        raise InvalidExplorationError(f"too large: an exploration has at most {LARGEST_FILE_BYTES} bytes")
    if not reader.eof:
        raise InvalidExplorationError("the file is cut off: copy or export it again")
    return unpacked


def _decode(content: bytes, kind: type[T]) -> T:
    """`content` as `kind`. Raises InvalidExplorationError, which names the member."""
    try:
        return msgspec.json.decode(content, type=kind)
    except msgspec.ValidationError as error:
        reason, _, path = str(error).partition(" - at `$")
        member = path.rstrip("`").removeprefix(".") or "the file"
        raise InvalidExplorationError(
            f"{member}: {reason}: correct the exploration, or export it again"
        ) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InvalidExplorationError(f"cannot be read as JSON ({error}): export it again") from error


def _mistakes(whole: Document) -> Iterator[str]:
    """Mistakes that a check of types does not find."""
    if whole.state == "done" and whole.finished_at is None:
        yield "finished_at: is missing, although the state is done"
    settings, last = whole.exploration, -1
    packs = (
        settings.sequence,
        *(pack.name for pack in settings.further_sequences + settings.held_out_sequences),
    )
    searched: dict[str, int] = {}
    for number, row in enumerate(whole.evaluations):
        at = f"evaluations[{number}]"
        if row.number <= last:
            yield f"{at}.number: {row.number} does not follow {last}: numbers increase"
        last = row.number
        if row.state == "done" and row.objectives is None:
            yield f"{at}.objectives: is missing, although the state is done"
        if row.state == "failed" and not row.error:
            yield f"{at}.error: is missing, although the state is failed"
        # What an earlier search measured may be of other sequences.
        for part in row.parts or () if row.phase != Evaluation.Phase.PRIOR else ():
            if part.sequence not in packs:
                yield f"{at}.parts: {part.sequence!r:.80} is not a sequence of the exploration"
        if row.phase in CHOSEN_ONCE:
            before = searched.setdefault(configuration_digest(row.configuration), row.number)
            if before != row.number:
                yield f"{at}.configuration: the search chose it as number {before} already"


def _first_mistake(error: ValidationError, where: str) -> str:
    """The first member that `error`, of a model, names, with the reason."""
    member, reasons = next(iter(error.message_dict.items()))
    return f"{where}.{member}: {reasons[0]} Correct the exploration, or export it again"
