"""The files that describe an export: written with it, so that they stay as they are.

After a rewriting of tables, only sizes and digests in them change.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from crowd.demo.mark import SENTENCE, is_demo
from crowd.results.marking import DIGESTS, PACKAGE, SUMS
from crowd.results.models import Export, ExportFile, StoredFile
from crowd.results.opendata.storing import describe, open_stored
from crowd.results.opendata.tables import LICENCE, TABLES, data_package

DATA_PACKAGE, LICENCE_FILE, SUMS_FILE = "datapackage.json", "LICENCE.txt", "SHA256SUMS"
LICENCE_TEXT = """\
These measurements are licensed under {title} ({name}):
{path}

You may share and adapt them for any purpose if you name their source: the Frontrunner server that
published them, and the day of the export. datapackage.json says what each column means.
tombstones lists what participants have erased: please delete it from copies of earlier exports.
"""
# The program that computes the published figures again.
RECOMPUTE = Path(__file__).with_name("recompute.py")
_TABLE_ORDER = {table.name: index for index, table in enumerate(TABLES)}


def ordered_files(export: Export) -> list[ExportFile]:
    """The files of `export`, ordered by table, part and format (Parquet before CSV), then descriptions."""
    return sorted(
        export.files.all(),
        key=lambda file: (
            _TABLE_ORDER.get(file.stored.table, len(TABLES)),
            file.part,
            file.stored.format == "csv",
            file.pk,
        ),
    )


def write(export: Export, files: Sequence[ExportFile], folder: Path) -> list[ExportFile]:
    """Write the descriptions of `export`, which has `files`, to `folder`. Returns their unsaved rows."""
    created = export.started_at.isoformat(timespec="seconds")
    licence = LICENCE_TEXT.format(**LICENCE) + (f"\n{SENTENCE}\n" if is_demo() else "")
    described = [
        _write(folder, RECOMPUTE.name, "recompute", "python", RECOMPUTE.read_text()),
        _write(folder, LICENCE_FILE, "licence", "text", licence),
        _write(folder, DATA_PACKAGE, PACKAGE, "json", _json(data_package(export.name, created, files))),
    ]
    sums = _sums([*files, *described])
    return [*described, _write(folder, SUMS_FILE, SUMS, "text", sums)]


def updated(export: Export, folder: Path) -> list[StoredFile]:
    """Write the descriptions of `export` that contain digests to `folder`, with those of its files now.

    Returns their unsaved rows; none while other files of `export` are stale.
    """
    files = ordered_files(export)
    others = [file for file in files if file.stored.table not in DIGESTS]
    if any(file.stored.stale for file in others):
        return []
    [package] = [file for file in files if file.stored.table == PACKAGE]
    with open_stored(package.stored) as earlier:
        content: dict[str, Any] = json.load(earlier)
    stored = {file.name: file.stored for file in others}
    for resource in content["resources"]:
        file = stored[resource["path"]]
        facts = {"bytes": file.bytes, "hash": f"sha256:{file.sha256}", "rows": file.rows}
        resource |= {name: value for name, value in facts.items() if name in resource}
    new = _write(folder, DATA_PACKAGE, PACKAGE, "json", _json(content))
    sums = _write(folder, SUMS_FILE, SUMS, "text", _sums([*others, new]))
    return [new.stored, sums.stored]


def _write(folder: Path, name: str, table: str, format: str, text: str) -> ExportFile:
    path = folder / name
    path.write_text(text)
    return describe(path, name, table, format)


def _json(content: dict[str, Any]) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _sums(files: Iterable[ExportFile]) -> str:
    return "".join(f"{file.stored.sha256}  {file.name}\n" for file in files)
