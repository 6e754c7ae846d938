"""CSV files of Android devices: Google Play's device catalogue, and lists of model names.

| column | accepted names |
|---|---|
| maker | Retail Branding, Brand, Manufacturer |
| market name | Model Name, Marketing Name, Name |
| device (Build.DEVICE) | Device, Codename; otherwise Model Code |
| code (Build.MODEL) | Model Code, Model |
| system on a chip, graphics chip | System on Chip; GPU |
"""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

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
