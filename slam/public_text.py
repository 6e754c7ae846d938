"""Texts of a machine that become public: on one line, and without its folders."""

import re

REASON_LENGTH = 500
# An absolute path of two parts or more, up to its last part. On Windows it has a drive, and a path that was
# quoted by repr() has its separators twice.
FOLDERS = re.compile(r"""(?<![\w.~])(?:[A-Za-z]:)?[/\\]+(?:[^\s/\\"'<>|:;,()]+[/\\]+)+(?=[^\s/\\])""")
# The same between quotation marks, where the names of folders may have spaces.
QUOTED = re.compile(r"""(?<=["'])(?:[A-Za-z]:)?[/\\]+(?:[^/\\"'<>|\n]+[/\\]+)+(?=[^"'/\\\n]+["'])""")


def without_folders(text: str) -> str:
    """`text` with only the last part of every absolute path in it."""
    return FOLDERS.sub("", QUOTED.sub("", text))


def one_line(text: str, length: int = REASON_LENGTH) -> str:
    """`text` on one line of `length` characters at most, without control characters.

    Some databases reject NUL, and pages must not contain a terminal's escape codes.
    """
    printable = "".join(character if character.isprintable() else " " for character in text)
    return " ".join(printable.split())[:length]
