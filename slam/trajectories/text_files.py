"""Text files from people and other programs."""

from __future__ import annotations

from pathlib import Path

UTF_16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def read_text(path: Path, error: type[ValueError]) -> str:
    """The text of `path`, which must be UTF-8; a byte order mark is left out.

    Raises `error` in one line where the file cannot be read or is text of another encoding.
    """
    try:
        data = path.read_bytes()
    except OSError as reason:
        raise error(f"{path} cannot be read: {reason.strerror}") from None
    if data.startswith(UTF_16_MARKS):
        raise error(f"{path} is text in UTF-16, as Windows PowerShell writes it: save it as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        raise error(f"{path} is not text in UTF-8 (see byte {reason.start}): save it as UTF-8") from None
