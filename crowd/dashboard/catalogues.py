"""gettext's catalogues of the participants' pages, compiled without gettext's programs."""

import io
import os
from pathlib import Path

from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po
from django.conf import settings

CATALOGUES = Path(__file__).parent / "locale"


def compile_catalogues() -> None:
    """Write gettext's binary form of each catalogue where Django reads it, unless it is there already."""
    [folder] = settings.LOCALE_PATHS
    for source in CATALOGUES.glob("*/LC_MESSAGES/*.po"):
        target = (folder / source.relative_to(CATALOGUES)).with_suffix(".mo")
        compiled = io.BytesIO()
        with source.open("rb") as file:
            write_mo(compiled, read_po(file))
        if not target.exists() or target.read_bytes() != compiled.getvalue():
            target.parent.mkdir(parents=True, exist_ok=True)
            new = target.with_suffix(f".{os.getpid()}")
            new.write_bytes(compiled.getvalue())
            new.replace(target)
