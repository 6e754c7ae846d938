"""The file of a whole exploration (wire/exploration.py): written, read and checked.

Workers' hosts and folders in texts do not travel.
"""

import gzip
import socket
import zlib
from collections.abc import Iterable, Iterator
from datetime import datetime
from typing import Any, TypeVar

import msgspec
from django.core.exceptions import ValidationError

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import public_rows
from crowd.explorations.searching.batches import configuration_digest
from crowd.explorations.searching.search import CHOSEN_ONCE, FINISHED, search_space, space_index
from slam.public_text import without_folders
from wire import exploration as wire
from wire.evaluation import EvaluationRow
from wire.exploration import FORMAT, VERSION, Document, Settings

LARGEST_FILE_BYTES = 64 << 20  # unpacked
T = TypeVar("T")


class InvalidExplorationError(ValueError):
    """The file is not a valid exploration; the message names the member and the remedy."""


class _Header(msgspec.Struct):
    format: Any = None
    version: Any = None


def digest(exploration: Exploration, evaluations: Iterable[Evaluation]) -> str:
    """The digest of `exploration` with its finished `evaluations`, as its file names it."""
    return wire.digest(_settings(exploration), _rows(evaluations))


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
        sha256=wire.digest(settings, rows),
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
    if (actual := wire.digest(whole.exploration, whole.evaluations)) != whole.sha256:
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
    fields = {name: getattr(exploration, name) for name in Settings.__struct_fields__}
    changes = {
        "prepares": "" if front is None else front.slug,
        "command": without_folders(exploration.command),
    }
    return msgspec.convert(fields | changes, Settings)


def _rows(evaluations: Iterable[Evaluation]) -> list[EvaluationRow]:
    """The finished ones of `evaluations` in the order of their numbers."""
    finished = sorted((row for row in evaluations if row.state in FINISHED), key=lambda row: row.number)
    return [msgspec.convert(public_rows.fields(row), EvaluationRow) for row in finished]


def _fields(struct: msgspec.Struct, *without: str) -> dict[str, Any]:
    """The fields of a model from `struct`, except those named."""
    names = [name for name in struct.__struct_fields__ if name not in without]
    return {name: msgspec.to_builtins(getattr(struct, name), builtin_types=[datetime]) for name in names}


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
        if row.state not in FINISHED or row.finished_at is None:
            yield f"{at}: is not finished"
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
