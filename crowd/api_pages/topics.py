"""The calls of the API by topic, and the error codes of each."""

from collections.abc import Mapping
from dataclasses import dataclass

from crowd.http import codes

ANY = (
    "bad_request", "database_unavailable", "internal_error", "method_not_allowed", "null_character",
    "server_not_prepared",
    "too_many_requests",
)  # fmt: skip
TOKEN = ("token_invalid", "token_missing")
LIST = ("invalid_cursor", "invalid_limit")
FILTERS = ("invalid_filter", "not_found")
BODY = (
    "body_incomplete", "body_too_large", "body_too_slow", "damaged_gzip", "inflated_too_large",
    "invalid_field", "length_required", "malformed_json", "not_finite", "server_busy", "text_too_long",
    "too_many_values", "unsupported_encoding", "unsupported_media_type",
)  # fmt: skip
CLIENT = ("app_outdated", "consent_outdated", "not_accepting")
# Of a submission as a whole. A code of RUN is answered if all runs have the same one.
SUBMISSION = (
    "all_runs_rejected", "daily_limit", "device_changed", "device_too_deep", "device_too_large",
    "extra_too_deep", "extra_too_large", "personal_data", "run_count", "unknown_schema_version",
)  # fmt: skip
SENDING = (*TOKEN, *BODY, *CLIENT, *SUBMISSION, *codes.RUN)


@dataclass(frozen=True)
class Topic:
    """A part of the API: its purpose, and the codes of each call except those of ANY call."""

    title: str
    purpose: str
    calls: Mapping[str, tuple[str, ...]]


TOPICS = (
    Topic(
        "Results",
        "What the crowd measured. Anyone can read it.",
        {
            "speedups": (*LIST, *FILTERS),
            "devices": (*LIST, *FILTERS),
            "device": ("not_found",),
            "compare": FILTERS,
            "sessions": (*LIST, *FILTERS),
            "session": FILTERS,
            "runs": (*LIST, *FILTERS),
            "exports": LIST,
        },
    ),
    Topic(
        "Fronts and recommendations",
        "What clients measure, and what to use on a device.",
        {
            "manifest": (*TOKEN, "invalid_filter", "front_outdated", "no_front"),
            "fronts": LIST,
            "front": ("not_found",),
            "recommendation": (*TOKEN, *FILTERS),
            "models": ("invalid_filter",),
        },
    ),
    Topic(
        "Explorations",
        "The searches that fronts come from.",
        {"explorations": LIST, "exploration": (*LIST, "not_found")},
    ),
    Topic(
        "Sending measurements",
        "For clients. Enrol once, then send sessions with the token.",
        {
            "enrol": (*BODY, "app_outdated", "consent_outdated", "demo_server"),
            "validate": SENDING,
            "submit": (*SENDING, "idempotency_key_missing", "idempotency_key_reused"),
            "submission": (*TOKEN, "not_found"),
            "attempt": BODY,
        },
    ),
    Topic(
        "Your data",
        "For the installation whose token comes with the request, also after the token was revoked.",
        {
            "own": TOKEN,
            "choose": (*TOKEN, *BODY),
            "own_data": TOKEN,
            "renew_token": TOKEN,
            "erase_run": (*TOKEN, "not_found"),
            "erase": TOKEN,
        },
    ),
    Topic(
        "Reference devices",
        "For machines that measure for explorations, with a token from an administrator.",
        {
            "lease": (
                *TOKEN,
                *BODY,
                "another_device",
                "client_outdated",
                "not_accepting",
                "sequence_missing",
            ),
            "heartbeat": (*TOKEN, "another_device", "lease_gone", "not_found"),
            "result": (*TOKEN, *BODY, "another_device", "lease_gone", "not_found"),
        },
    ),
)


def topic_of(call: str) -> Topic:
    """The topic of the call with the operation id `call`. Raises KeyError if it has none."""
    for topic in TOPICS:
        if call in topic.calls:
            return topic
    raise KeyError(f"{call} has no topic: add it to crowd/api_pages/topics.py")


def codes_of(call: str) -> tuple[str, ...]:
    """Every error code of `call`, in alphabetical order."""
    return tuple(sorted({*topic_of(call).calls[call], *ANY}))
