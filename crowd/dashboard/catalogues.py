"""gettext's catalogues of the participants' pages, compiled without gettext's programs."""

import json
import os
import re
import struct
from collections.abc import Mapping
from pathlib import Path

from django.conf import settings

CATALOGUES = Path(__file__).parent / "locale"
STRING = r'"(?:[^"\\]|\\.)*"'
LINE = re.compile(rf"^(msgid|msgid_plural|msgstr)(?:\[(\d)\])?\s+({STRING}(?:\s+{STRING})*)", re.MULTILINE)


def compile_catalogues() -> None:
    """Write gettext's binary form of each catalogue where Django reads it, if its source is newer."""
    [folder] = settings.LOCALE_PATHS
    for source in CATALOGUES.glob("*/LC_MESSAGES/*.po"):
        target = (folder / source.relative_to(CATALOGUES)).with_suffix(".mo")
        content = compiled(entries(source.read_text(encoding="utf-8")))
        if not target.exists() or target.read_bytes() != content:
            target.parent.mkdir(parents=True, exist_ok=True)
            new = target.with_suffix(f".{os.getpid()}")
            new.write_bytes(content)
            new.replace(target)


def entries(catalogue: str) -> dict[str, str]:
    """The translations of a .po file by sentence. A NUL separates plurals and further forms."""
    pairs: list[list[str]] = []
    for keyword, number, quoted in LINE.findall(catalogue):
        text = "".join(json.loads(part) for part in re.findall(STRING, quoted))
        if keyword == "msgid":
            pairs.append([text, ""])
        elif keyword == "msgid_plural":
            pairs[-1][0] += "\0" + text
        else:
            pairs[-1][1] += ("\0" if int(number or 0) else "") + text
    return dict(pairs)


def compiled(translations: Mapping[str, str]) -> bytes:
    """A .mo file: the GNU gettext manual, "The Format of GNU MO Files"."""
    pairs = sorted((key.encode(), text.encode()) for key, text in translations.items() if text)
    texts = [*(key for key, _ in pairs), *(text for _, text in pairs)]
    count, table, end = len(pairs), b"", 28 + 16 * len(pairs)
    for text in texts:
        table += struct.pack("<2I", len(text), end)
        end += len(text) + 1
    header = struct.pack("<7I", 0x950412DE, 0, count, 28, 28 + 8 * count, 0, 0)
    return header + table + b"".join(text + b"\0" for text in texts)
