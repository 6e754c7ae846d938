"""Decode JSON into typed structs. A refusal names the member that does not fit."""

import re
from typing import TypeVar

import msgspec

from crowd.http import json_limits
from crowd.http.problems import Problem

T = TypeVar("T")
ERROR_PATH = re.compile(r" - at `\$(?P<path>[^`]*)`$")
ERROR_OFFSET = re.compile(r"\(byte (?P<offset>\d+)\)$")
NOT_FINITE = re.compile(rb"-?(NaN|Infinity|inf)", re.IGNORECASE)


def decode_body(decoder: "msgspec.json.Decoder[T]", body: bytes) -> T:
    """Decode `body`, a whole request. `json_limits` bounds its size in memory.

    Raises Problem 400 for invalid JSON, too much of it, or a member that does not fit (in `field`).
    """
    json_limits.check(body)
    # PostgreSQL cannot store NUL in text, and no name of a device contains it.
    if b"\\u0000" in body:
        raise Problem("null_character", "a text contains the character NUL (\\u0000): leave it out")
    try:
        return decoder.decode(body)
    except msgspec.ValidationError as error:
        raise _wrong_type(str(error)) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _malformed(str(error), body) from error


def decode_part(decoder: "msgspec.json.Decoder[T]", part: msgspec.Raw, where: str = "") -> T:
    """Decode `part` of a body that `decode_body` has read. `where` is its path in that body.

    Raises Problem 400 for a member that does not fit; `field` is `where` and the member.
    """
    try:
        return decoder.decode(part)
    except msgspec.ValidationError as error:
        raise _wrong_type(str(error), where) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _malformed(str(error), b"") from error


def raw_size(part: msgspec.Raw) -> int:
    """The bytes of `part` as it was sent."""
    return memoryview(part).nbytes


def _wrong_type(message: str, before: str = "") -> Problem:
    where = ERROR_PATH.search(message)
    path = where["path"] if where else ""
    text = message[: where.start()] if where else message
    # A path begins with the dot of a member, or the bracket of an index.
    field = f"{before}{path}".lstrip(".") or None
    if text == "Number out of range":
        return Problem("not_finite", f"{text}: infinite numbers are not JSON", field=field)
    return Problem("invalid_field", text, field=field)


def _malformed(message: str, body: bytes) -> Problem:
    offset = ERROR_OFFSET.search(message)
    if offset and NOT_FINITE.match(body, int(offset["offset"])):
        return Problem(
            "not_finite",
            f"NaN and infinite numbers are not JSON; write null, or leave it out ({message})",
        )
    return Problem("malformed_json", message)
