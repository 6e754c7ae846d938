"""Line breaking without a browser, by upper bounds for letter widths of Helvetica and Arial."""

import unicodedata

WIDE, NARROW = "MWmw@%\N{EM DASH}", "ijltfrI.,:;|!'()[]/ \N{NO-BREAK SPACE}"


def wrapped(text: str, size: float, room: float, cut: bool = True) -> list[str]:
    """`text` in lines of at most `room` at the font `size`.

    A wider word, such as an address, is cut, or gets its own line if `cut` is false.
    """
    lines: list[str] = []
    for word in text.split(" "):
        joined = f"{lines[-1]} {word}" if lines else word
        if text_width(joined, size) <= room:
            lines[-1:] = [joined]
            continue
        if cut and lines and text_width(word, size) > room:
            # The part that fits stays on the line.
            head, word = _cut(word, size, room - text_width(lines[-1] + " ", size))
            lines[-1] = f"{lines[-1]} {head}".rstrip()
        while cut and text_width(word, size) > room:
            head, word = _cut(word, size, room)
            lines.append(head)
        lines.append(word)
    return lines


def _cut(word: str, size: float, room: float) -> tuple[str, str]:
    """`word` in two parts, of which the first fits into `room`; cut after a separator, if any."""
    fits = max((length for length in range(len(word)) if text_width(word[:length], size) <= room), default=0)
    at = max(word.rfind(sign, 0, fits) for sign in "/?&=-,")
    at = at + 1 if at > fits // 3 else fits
    return word[:at], word[at:]


def text_width(text: str, size: float) -> float:
    """An upper bound for the width of `text` at `size`."""
    return size * sum(_letter_width(letter) for letter in text)


def _letter_width(letter: str) -> float:
    """The width of `letter` in units of the font size, rounded up."""
    if unicodedata.east_asian_width(letter) in "WF":
        return 1.0
    if letter in WIDE:
        return 1.0
    if letter in NARROW:
        return 0.34
    return 0.72 if letter.isupper() else 0.56
