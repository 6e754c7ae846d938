"""The imported catalogue of Android devices: the market name and the chips behind a maker's code.

Files are CSV: Google Play's device catalogue, and lists of model names.
"""

import csv
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from django.db import transaction
from django.db.models import Q

from crowd.devices import revision
from crowd.devices.models import CatalogueEntry
from crowd.devices.naming import chips, names
from crowd.devices.naming.raw_device import RawDevice

# The names of a column in a file, in lower case. The first that a file has counts.
COLUMNS = {
    "maker": ("retail branding", "brand", "manufacturer"),
    "market_name": ("model name", "marketing name", "name"),
    "device": ("device", "codename", "model code"),
    "code": ("model code", "model"),
    "soc": ("system on chip",),
    "gpu": ("gpu",),
}
LONGEST = {"maker": 100, "market_name": 150, "device": 100, "code": 100, "soc": 200, "gpu": 200}
ABSENT = frozenset({"", "unknown", "null", "n/a"})
BATCH = 2_000
# A device name that more entries share does not identify a device.
MOST_ENTRIES = 100


class CatalogueFileError(ValueError):
    """The file is not a catalogue; the message says what it contains and what is needed."""


@dataclass(frozen=True)
class CatalogueLine:
    """A device of a catalogue. Texts are empty if the catalogue does not give them."""

    number: int
    maker: str
    market_name: str
    device: str
    code: str
    soc: str
    gpu: str


@dataclass(frozen=True)
class BadLine:
    """A line that is not a valid device, and the reason."""

    number: int
    reason: str


def read(path: Path) -> Iterator[CatalogueLine | BadLine]:
    """Read the devices of `path`, in UTF-8 or UTF-16, in order. Raises CatalogueFileError, OSError."""
    with path.open("rb") as probe:
        encoding = "utf-16" if probe.read(2) in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    with path.open(newline="", encoding=encoding) as file:
        rows = csv.reader(file)
        try:
            header = next(rows, [])
            columns = _columns(header)
            for row in rows:
                if any(cell.strip() for cell in row):
                    yield _line(rows.line_num, row, len(header), columns)
        except UnicodeDecodeError as error:
            raise CatalogueFileError(
                f"{path} is neither UTF-8 nor UTF-16 with a byte order mark: {error}"
            ) from error
        except csv.Error as error:
            raise CatalogueFileError(f"{path}, line {rows.line_num}: {error}") from error


def _columns(header: list[str]) -> dict[str, int]:
    """The index of each column. Raises CatalogueFileError if names or keys of devices are missing."""
    indices = {name.strip().casefold(): index for index, name in enumerate(header)}
    columns = {
        column: indices[name]
        for column, names in COLUMNS.items()
        for name in reversed(names)
        if name in indices
    }
    if "market_name" not in columns or not {"device", "code"} & columns.keys():
        had = ", ".join(header) or "nothing"
        raise CatalogueFileError(
            f"the first line names {had}: a catalogue needs a column Model Name, Marketing Name or Name, and "
            "one of Device, Codename, Model Code or Model"
        )
    return columns


def _line(number: int, row: list[str], width: int, columns: Mapping[str, int]) -> CatalogueLine | BadLine:
    if len(row) != width:
        return BadLine(number, f"{len(row)} columns instead of {width}")
    cells = {column: " ".join(row[index].split()) for column, index in columns.items()}
    values = {
        column: "" if cells.get(column, "").casefold() in ABSENT else cells[column] for column in COLUMNS
    }
    if not values["market_name"]:
        return BadLine(number, "no market name")
    if not values["device"] and not values["code"]:
        return BadLine(number, "neither a device name nor a code")
    for column, most in LONGEST.items():
        if len(values[column]) > most or "\0" in values[column]:
            return BadLine(
                number, f"{column} {values[column][:40]!r}... is longer than {most} characters or holds NUL"
            )
    return CatalogueLine(number=number, **values)


@dataclass(frozen=True)
class Entry:
    """What the catalogue says of a device; texts are empty if it is silent or contradictory."""

    market_name: str = ""
    soc: str = ""
    gpu: str = ""


@dataclass
class ImportReport:
    """The result of an import: lines read; entries new, changed and unchanged; invalid lines."""

    read: int = 0
    new: int = 0
    changed: int = 0
    same: int = 0
    bad: list[BadLine] = field(default_factory=list)


def look_up(raw: RawDevice) -> Entry:
    """What the catalogue says of the device behind `raw`. One query, or none if `raw` has no model.

    Entries of its maker or brand count. A browser reports neither, but some models are of one maker only. The
    closest ones win: by code and device name, then by code, then by device name. Entries without a maker
    count if both code and device name match. A value on which the closest entries disagree stays empty.
    """
    code, device = raw.model.casefold(), raw.device.casefold()
    if not code and not device:
        return Entry()
    reported = raw.manufacturer, raw.brand or (names.maker_of(raw.model) if raw.is_browser else "")
    makers = {names.manufacturer(maker).casefold() for maker in reported} - {""}
    sold = (Q(device=device) if device else Q()) | (Q(code=code) if code else Q())
    wanted = sold & Q(maker__in=makers)
    if code and device:
        wanted |= Q(maker="", code=code, device=device)
    entries = CatalogueEntry.objects.filter(wanted)[:MOST_ENTRIES]
    ranked: dict[int, list[CatalogueEntry]] = {}
    for entry in entries:
        agreed = 2 * (code != "" and entry.code == code) + (device != "" and entry.device == device)
        ranked.setdefault(agreed if entry.maker else 0, []).append(entry)
    closest = ranked[max(ranked)] if ranked else []
    return Entry(
        *(_only_value(getattr(entry, part) for entry in closest) for part in ("market_name", "soc", "gpu"))
    )


def _only_value(values: Iterable[str]) -> str:
    distinct = set(values) - {""}
    return distinct.pop() if len(distinct) == 1 else ""


@transaction.atomic
def store(lines: Iterable[CatalogueLine | BadLine]) -> ImportReport:
    """Update the catalogue from `lines`. Entries that are not in `lines` stay.

    If two lines of a file give different market names for one device, the first one counts.
    """
    done = ImportReport()
    stored = {(row.maker, row.device, row.code): row for row in CatalogueEntry.objects.all()}
    seen: dict[tuple[str, str, str], int] = {}
    new: list[CatalogueEntry] = []
    changed: list[CatalogueEntry] = []
    for line in lines:
        done.read += 1
        if isinstance(line, BadLine):
            done.bad.append(line)
            continue
        row = _entry(line)
        key = (row.maker, row.device, row.code)
        earlier = stored.get(key)
        if key in seen:
            if earlier is not None and names.folded(earlier.market_name) != names.folded(row.market_name):
                reason = (
                    f"line {seen[key]} sells it as {earlier.market_name!r}, this one as {row.market_name!r}"
                )
                done.bad.append(BadLine(line.number, reason))
            else:
                done.same += 1
            continue
        seen[key] = line.number
        if earlier is None:
            stored[key] = row
            new.append(row)
        elif _differs(earlier, row):
            earlier.market_name, earlier.soc, earlier.gpu = row.market_name, row.soc, row.gpu
            changed.append(earlier)
        else:
            done.same += 1
    CatalogueEntry.objects.bulk_create(new, batch_size=BATCH)
    CatalogueEntry.objects.bulk_update(changed, ["market_name", "soc", "gpu"], batch_size=BATCH // 10)
    done.new, done.changed = len(new), len(changed)
    revision.bump()
    return done


def _entry(line: CatalogueLine) -> CatalogueEntry:
    """The entry for `line`. An unknown chip is kept as written, because an administrator chose the file."""
    chip = chips.graphics(line.gpu)
    return CatalogueEntry(
        maker=names.manufacturer(line.maker).casefold(),
        device=line.device.casefold(),
        code=line.code.casefold(),
        market_name=line.market_name,
        soc=(chips.system_on_chip(line.soc) or line.soc)[:100],
        gpu=(chip.name if chip else line.gpu)[:150],
    )


def _differs(stored: CatalogueEntry, row: CatalogueEntry) -> bool:
    """Whether `row` differs from `stored`. A list without chips does not remove chips."""
    row.soc, row.gpu = row.soc or stored.soc, row.gpu or stored.gpu
    return (stored.market_name, stored.soc, stored.gpu) != (row.market_name, row.soc, row.gpu)
