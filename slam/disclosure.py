"""Remove a machine's paths from a text that it wrote, before the text is published."""

import re

# An absolute path of two parts or more, up to its last part. On Windows it has a drive, and a path that was
# quoted by repr() has its separators twice.
FOLDERS = re.compile(r"""(?<![\w.~])(?:[A-Za-z]:)?[/\\]+(?:[^\s/\\"'<>|:;,()]+[/\\]+)+(?=[^\s/\\])""")
# The same between quotation marks, where the names of folders may have spaces.
QUOTED = re.compile(r"""(?<=["'])(?:[A-Za-z]:)?[/\\]+(?:[^/\\"'<>|\n]+[/\\]+)+(?=[^"'/\\\n]+["'])""")


def public(text: str) -> str:
    """TEXT with the last part alone of every absolute path in it."""
    return FOLDERS.sub("", QUOTED.sub("", text))
