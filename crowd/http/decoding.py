"""JSON into typed structs; what does not fit is refused with the place where it does not."""

import re
from typing import TypeVar

import msgspec

from crowd.http import json_limits
from crowd.http.problems import Problem

T = TypeVar("T")
WHERE = re.compile(r" - at `\$(?P<path>[^`]*)`$")
OFFSET = re.compile(r"\(byte (?P<offset>\d+)\)$")
NOT_FINITE = re.compile(rb"-?(NaN|Infinity|inf)", re.IGNORECASE)


def decoded(decoder: "msgspec.json.Decoder[T]", body: bytes) -> T:
    """BODY, a whole request, as what DECODER reads. Its size in memory is bounded by `json_limits`.

    Raises Problem 400 for what is not JSON, is too large or does not fit, with the member in `field`.
    """
    json_limits.check(body)
    # PostgreSQL stores no NUL in text, and no device's name has one.
    if b"\\u0000" in body:
        raise Problem(400, "null_character", "a text holds the character NUL (\\u0000): leave it out")
    try:
        return decoder.decode(body)
    except msgspec.ValidationError as error:
        raise _wrong_type(str(error)) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _malformed(str(error), body) from error


def decoded_part(decoder: "msgspec.json.Decoder[T]", part: msgspec.Raw, where: str = "") -> T:
    """PART of a body that `decoded` has read, as what DECODER reads; it stands at WHERE in that body.

    Raises Problem 400 for what does not fit, with the member in `field`, WHERE before it.
    """
    try:
        return decoder.decode(part)
    except msgspec.ValidationError as error:
        raise _wrong_type(str(error), where) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _malformed(str(error), b"") from error


def size_of(part: msgspec.Raw) -> int:
    """How many bytes PART has as it was sent."""
    return memoryview(part).nbytes


def _wrong_type(message: str, before: str = "") -> Problem:
    where = WHERE.search(message)
    path = where["path"] if where else ""
    text = message[: where.start()] if where else message
    # A path begins with the dot of a member, or the bracket of an index.
    field = f"{before}{path}".lstrip(".") or None
    if text == "Number out of range":
        return Problem(400, "not_finite", f"{text}: infinite numbers are not JSON", field=field)
    return Problem(400, "invalid_field", text, field=field)


def _malformed(message: str, body: bytes) -> Problem:
    offset = OFFSET.search(message)
    if offset and NOT_FINITE.match(body, int(offset["offset"])):
        return Problem(
            400,
            "not_finite",
            f"NaN and infinite numbers are not JSON; write null, or leave it out ({message})",
        )
    return Problem(400, "malformed_json", message)
