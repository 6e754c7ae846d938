"""An answer as readable lines, without what differs between machines or follows other files."""

import gzip
import hashlib
import io
import json
import re
from collections.abc import Mapping
from typing import Any

import pyarrow.parquet

WIDTH = 110
DIGITS = 9  # processors and libraries differ in the last ones
NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d+(?:e[+-]?\d+)?(?![\w.])")
LONGEST_SERIES, SHOWN = 8, 3
# Of these files (a prefix), tables are cut like series of numbers.
CUT = ("tables/", "figures/")
# Words in the place of members, by the file of their answer.
PROGRAM = dict.fromkeys(("plan", "shaders", "module"), "follows the program")
COMPRESSED = {"bytes": "follows the compression", "sha256": "follows the compression", "hash": "follows them"}
WORDS: dict[str, dict[str, str]] = {
    "data/description": COMPRESSED,
    "exports": COMPRESSED,
    "front": PROGRAM,
    "manifest": PROGRAM,
    "openapi": {"example": "is in crowd/api_pages/examples.json"},
    "ready": {"disk_free_bytes": "differs between machines"},
}


def content(kind: str, body: bytes, file: str) -> dict[str, Any]:
    """`body` of the media type `kind`, an answer of `file`, as a member of its snapshot."""
    if "json" in kind:
        return {"answer": _plain(json.loads(body), file)}
    if kind == "application/vnd.apache.parquet":
        return _parquet(body)
    text = gzip.decompress(body) if kind == "application/gzip" else body
    rounded = NUMBER.sub(lambda found: str(_round(float(found[0]))), text.decode())
    return {"lines": _cut(rounded.splitlines())} if body else {}


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _plain(value: Any, file: str) -> Any:
    """`value`, a part of an answer of `file`, with words for what varies and with long series cut."""
    words = WORDS.get(file, {})

    def part(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: words.get(name) or part(each) for name, each in value.items()}
        if isinstance(value, list):
            parts = [part(each) for each in value]
            is_series = not isinstance(next(iter(parts), ""), str | dict)
            return _cut(parts) if is_series or file.startswith(CUT) else parts
        return _round(value) if isinstance(value, float) else value

    return part(value)


def _cut(series: list[Any]) -> list[Any]:
    """`series` with the digest of its end in its place, if it is long."""
    if len(series) <= LONGEST_SERIES:
        return series
    rest = series[SHOWN:]
    digest = hashlib.sha256(json.dumps(rest).encode()).hexdigest()[:12]
    return [*series[:SHOWN], f"{len(rest)} more: {digest}"]


def _parquet(body: bytes) -> dict[str, Any]:
    """The schema, and a row of each state, reason and set of empty columns."""
    table = pyarrow.parquet.read_table(io.BytesIO(body))
    columns = [f"{field.name}: {field.type} [{' | '.join(_texts(field.metadata))}]" for field in table.schema]
    rows = json.loads(json.dumps(table.to_pylist(), default=str))
    shown: dict[Any, Any] = {}
    for row in rows:
        empty = tuple(name for name, value in row.items() if value in (None, [], ""))
        shown.setdefault((row.get("state"), row.get("reason"), empty), row)
    parts = [_plain(row, "") for row in rows]
    digest = hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:12]
    return {
        "schema": columns,
        "metadata": _texts(table.schema.metadata),
        "rows": [_plain(row, "") for row in shown.values()],
        "all": f"{len(rows)} rows: {digest}",
    }


def _texts(metadata: Mapping[bytes, bytes]) -> list[str]:
    return [f"{name.decode()}: {value.decode()}" for name, value in metadata.items()]


def lines(value: Any, indent: str = "") -> str:
    """`value` as JSON whose lines are at most WIDTH long where possible."""
    short = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(short) <= WIDTH or not value or not isinstance(value, dict | list):
        return short
    deeper = indent + " "
    if isinstance(value, dict):
        parts = [f"{deeper}{json.dumps(name)}: {lines(each, deeper)}" for name, each in value.items()]
        return "{\n" + ",\n".join(parts) + f"\n{indent}}}"
    return "[\n" + ",\n".join(deeper + lines(each, deeper) for each in value) + f"\n{indent}]"
