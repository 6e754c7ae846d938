"""The files that describe an export, generated from its rows for each request, so that they always agree."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from crowd.demo.mark import SENTENCE, is_demo
from crowd.results.models import Export, ExportFile
from crowd.results.opendata.tables import LICENCE, TABLES, data_package

DATA_PACKAGE, LICENCE_FILE, SUMS = "datapackage.json", "LICENCE.txt", "SHA256SUMS"
FORMATS = {DATA_PACKAGE: "json", LICENCE_FILE: "text", SUMS: "text"}
LICENCE_TEXT = """\
These measurements are licensed under {title} ({name}):
{path}

You may share and adapt them for any purpose if you name their source: the Frontrunner server that
published them, and the day of the export. datapackage.json says what each column means.
tombstones lists what participants have erased: please delete it from copies of earlier exports.
"""
_TABLE_ORDER = {table.name: index for index, table in enumerate(TABLES)}


def ordered_files(export: Export) -> list[ExportFile]:
    """The files of `export`, ordered by table, part and format (Parquet before CSV)."""
    return sorted(
        export.files.all(), key=lambda file: (_TABLE_ORDER[file.table], file.part, file.format != "parquet")
    )


def descriptions(export: Export) -> Mapping[str, bytes]:
    """The content of the describing files of `export` by name."""
    files = ordered_files(export)
    package = data_package(export.name, export.started_at.isoformat(timespec="seconds"), files)
    texts: dict[str, bytes] = {
        DATA_PACKAGE: (json.dumps(package, indent=1, ensure_ascii=False) + "\n").encode(),
        LICENCE_FILE: (LICENCE_TEXT.format(**LICENCE) + (f"\n{SENTENCE}\n" if is_demo() else "")).encode(),
    }
    sums: list[tuple[Any, str]] = [(file.sha256, file.name) for file in files]
    sums += [(hashlib.sha256(text).hexdigest(), name) for name, text in texts.items()]
    return texts | {SUMS: "".join(f"{digest}  {name}\n" for digest, name in sums).encode()}
