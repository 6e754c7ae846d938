"""Limits of a JSON text, checked before it is decoded: depth, number of values, length of texts.

A few kilobytes of JSON can decode to hundreds of megabytes of objects. This scan reads the bytes once, in
blocks, without building objects and without recursion. It does not validate the JSON: for every text that a
decoder accepts, depth and number of values are as counted here.
"""

import numpy as np
from numpy.typing import NDArray

from crowd.http.problems import Problem

MAX_DEPTH = 16
# Commas, colons and opening brackets. The largest submission of a client has about 140,000: 50 runs with 16
# stages of 100 frames, and 5,000 samples.
MAX_VALUES = 160_000
MAX_TEXT_BYTES = 64 << 10
BLOCK = 64 << 10

_QUOTE, _OPENING, _CLOSING, _SEPARATOR = 1, 2, 3, 4
_KINDS = np.zeros(256, dtype=np.uint8)
for _characters, _kind in ((b'"', _QUOTE), (b"[{", _OPENING), (b"]}", _CLOSING), (b",:", _SEPARATOR)):
    _KINDS[list(_characters)] = _kind
_STEPS = np.zeros(5, dtype=np.int8)  # of the depth, by kind
_STEPS[[_OPENING, _CLOSING]] = 1, -1
_BACKSLASH = ord("\\")


def check(body: bytes) -> None:
    """Raises Problem 400 where `body` nests deeper than MAX_DEPTH (malformed_json), has more than MAX_VALUES
    values (too_many_values), or holds a text of more than MAX_TEXT_BYTES (text_too_long).
    """
    depth = values = 0
    text_start: int | None = None  # of the text that the last block left open
    escaped = False  # whether the last block ended with a backslash that escapes the next byte
    for start in range(0, len(body), BLOCK):
        block = np.frombuffer(body, np.uint8, min(BLOCK, len(body) - start), start)
        kinds = _KINDS[block]
        unread, escaped = _escaped(block, escaped)
        kinds[unread] = 0
        places = np.flatnonzero(kinds)
        kinds = kinds[places]
        is_quote = kinds == _QUOTE
        quotes_before = np.cumsum(is_quote) + (text_start is not None)
        structure = kinds[(quotes_before % 2 == 0) & ~is_quote]
        depths = depth + np.cumsum(_STEPS[structure], dtype=np.int64)
        if structure.size:
            if depths.max() > MAX_DEPTH:
                raise Problem("malformed_json", f"the body is nested deeper than {MAX_DEPTH} levels")
            depth = int(depths[-1])
        values += int(np.count_nonzero(structure != _CLOSING))
        if values > MAX_VALUES:
            raise Problem(
                "too_many_values", f"the body has more than {MAX_VALUES} values: send fewer runs at once"
            )
        text_start = _check_texts(places[is_quote] + start, text_start, start + block.size)


def _escaped(block: NDArray[np.uint8], first_is: bool) -> tuple[NDArray[np.intp], bool]:
    """The places in `block` that an odd number of backslashes precedes, and whether that holds for the byte
    after it. `first_is`: whether it holds for the first byte.
    """
    backslashes = np.flatnonzero(block == _BACKSLASH)
    first = np.zeros(int(first_is), dtype=np.intp)
    if not backslashes.size:
        return first, False
    starts = backslashes[np.diff(backslashes, prepend=-2) != 1]
    ends = backslashes[np.diff(backslashes, append=block.size + 1) != 1] + 1
    lengths = ends - starts
    if first_is and starts[0] == 0:
        lengths[0] -= 1  # its first backslash is escaped itself
    following = ends[lengths % 2 == 1]
    inside = following[following < block.size]
    return np.concatenate([first, inside]), bool(inside.size < following.size)


def _check_texts(quotes: NDArray[np.intp], open_since: int | None, end: int) -> int | None:
    """Where the text begins that is open at `end`, None without one. `quotes` are the places of quotation
    marks, `open_since` that of an earlier one without its partner.
    """
    if open_since is not None:
        quotes = np.concatenate([[open_since], quotes])
    last = int(quotes[-1]) if quotes.size % 2 else None
    longest = int((quotes[1::2] - quotes[:-1:2]).max()) if quotes.size > 1 else 0
    if max(longest, 0 if last is None else end - last) > MAX_TEXT_BYTES:
        raise Problem("text_too_long", f"a text has more than {MAX_TEXT_BYTES} bytes")
    return last
