"""JSON into typed structs; what does not fit is refused with the place where it does not."""

import re
from typing import TypeVar

import msgspec

from crowd.problems import Problem

T = TypeVar("T")
WHERE = re.compile(r" - at `\$(?P<path>[^`]*)`$")
OFFSET = re.compile(r"\(byte (?P<offset>\d+)\)$")
NOT_FINITE = re.compile(rb"-?(NaN|Infinity|inf)", re.IGNORECASE)


def decoded(decoder: "msgspec.json.Decoder[T]", body: bytes) -> T:
    """BODY as what DECODER reads.

    Raises Problem 400 for what is no JSON or does not fit, with the member in `field`.
    """
    # PostgreSQL stores no NUL in text, and no device's name has one.
    if b"\\u0000" in body:
        raise Problem(400, "null_character", "a text holds the character NUL (\\u0000): leave it out")
    try:
        return decoder.decode(body)
    except msgspec.ValidationError as error:
        raise _wrong_type(str(error)) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _malformed(str(error), body) from error


def _wrong_type(message: str) -> Problem:
    where = WHERE.search(message)
    field = where["path"].lstrip(".") if where else None
    text = message[: where.start()] if where else message
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
