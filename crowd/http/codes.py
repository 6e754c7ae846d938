"""Every code of a refusal, and what to do about it: the one place that problems, docs page and tests read.

A code is stable: programs decide by it. What it says may be said better, what it means never changes.
"""

ADDRESS = "/api/v1/docs#code-{code}"

# The request as a whole.
REQUEST = {
    "bad_request": "The server does not serve this host or cannot read the request: check the address.",
    "body_incomplete": "The connection ended before the body did: send it again.",
    "body_too_large": "The body has more bytes than the server takes: send fewer runs at once.",
    "body_too_slow": "The body did not arrive in time: send it again on a better connection.",
    "damaged_gzip": "Content-Encoding says gzip, the body is not whole gzip: compress it again.",
    "forbidden": "This is not for the one who asks.",
    "inflated_too_large": "The body inflates to far more than was sent: send fewer runs at once.",
    "invalid_cursor": "The cursor is none, or its row is gone: start again without one.",
    "invalid_field": "A member has the wrong type or a value out of range: `field` names it.",
    "invalid_filter": "A filter cannot be understood: `detail` says what would be right.",
    "invalid_limit": "`limit` is none: give a whole number from 1 to 1000.",
    "length_required": "Content-Length is no number, or missing and the server cannot read chunks: send it.",
    "malformed_json": "The body is not JSON, or is nested too deeply.",
    "method_not_allowed": "The address exists, the method does not: `Allow` names those that do.",
    "not_finite": "NaN and infinite numbers are not JSON: write null, or leave the member out.",
    "not_found": "There is nothing at this address, or not for this token.",
    "null_character": "A text holds the character NUL: leave it out.",
    "text_too_long": "A text has more than 65536 bytes.",
    "too_many_values": "The body has more than 160000 values: send fewer runs at once.",
    "unsupported_encoding": "Send gzip, or no Content-Encoding.",
    "unsupported_media_type": "Send Content-Type: application/json.",
}
# Who asks, how often, and whether the server takes anything now.
ACCESS = {
    "app_outdated": "This program is too old for the server: update it; `minimum_app_version` says to what.",
    "consent_outdated": "The participant agreed to another text than the present one: ask again.",
    "daily_limit": "The installation or its address sent as much as a day allows: wait as Retry-After says.",
    "database_unavailable": "The database does not answer: nothing was stored; wait as Retry-After says.",
    "internal_error": "The server failed and stored nothing: its log has the reason. Try again later.",
    "not_accepting": "No measurements are taken at present: keep them, and try again as Retry-After says.",
    "server_busy": "The server reads too many large bodies now: wait as Retry-After says.",
    "simulation_not_permitted": "The permit to send simulated data is none, or too old: ask for a new one.",
    "token_invalid": "The token is unknown, was revoked or its data erased: get a new one.",
    "token_missing": "Send Authorization: Bearer TOKEN.",
    "too_many_requests": "A limit is reached: wait as Retry-After says; the RateLimit fields tell the limit.",
}
# A submission as a whole.
SUBMISSION = {
    "all_runs_rejected": "No run can be taken, for different reasons: `items` tells each.",
    "device_changed": "The installation belongs to another device: enrol again for a second device.",
    "device_too_deep": "The device's description is nested too deeply.",
    "device_too_large": "The device's description takes too many bytes.",
    "extra_too_deep": "Members that this version does not know are nested too deeply.",
    "extra_too_large": "Members that this version does not know take too many bytes.",
    "idempotency_key_missing": "Send Idempotency-Key: 1 to 128 printable characters, new for each body.",
    "idempotency_key_reused": "This key came with another body before: use a new key for a new body.",
    "personal_data": "A member's name tells who somebody is, or where: leave it out.",
    "run_count": "A submission has 1 to 50 runs: split it.",
    "unknown_schema_version": "This server reads schema_version 1.",
}
# One run; the others of the submission are judged by themselves.
RUN = {
    "deviation_missing": "Protocol 2 needs each ok run's largest distance from the reference trajectory.",
    "empty_frame_missing": "Protocol 2 needs what an empty frame costs on the session's backend.",
    "frame_count": "A run has one value a frame: as many as the protocol says unless it failed.",
    "negative_error": "An error is a distance in metres: 0 or more.",
    "negative_time": "A time is 0 microseconds or more.",
    "repeat_taken": "This repeat of the configuration is there already, under another id.",
    "session_taken": "Another session has this id: use a new one.",
    "stage_clock_missing": "Protocol 2 needs what took the times of the stages: device, wall or none.",
    "stages_without_clock": "The session's `stage_clock` is none: its runs have no stages.",
    "time_too_large": "A frame takes at most 60 seconds: 60000000 microseconds.",
    "too_many_repeats": "Protocol 2 fixes the repeats of each configuration: send no more.",
    "too_many_samples": "A session has at most one sample a second, and none after its end.",
    "too_many_stages": "A run has 16 stages at most.",
    "unknown_configuration": "The front has no configuration of this name.",
    "unknown_front_version": "No front of this name is published here: read the manifest again.",
    "unknown_protocol_version": "The front is measured by another protocol: read the manifest again.",
    "zero_time": "Every counted frame took 0 microseconds: the clock did not run.",
}
# Reading.
READING = {
    "export_in_preparation": "No export of the open data can be had now: wait as Retry-After says.",
    "export_withdrawn": "The export held something that was erased since: take the latest one.",
    "no_front": "No front of this application is published here.",
}
# Reference devices.
LEASES = {
    "another_device": "The token belongs to another reference device.",
    "lease_gone": "The lease ran out or its exploration was cancelled: drop the result.",
    "client_outdated": "All that waits needs a newer client: update it.",
    "sequence_missing": "The server lacks the sequence of what waits: its administrator must add it.",
}
GROUPS = {
    "Any request": REQUEST,
    "Access, limits and the server's state": ACCESS,
    "A whole submission": SUBMISSION,
    "One run": RUN,
    "Reading": READING,
    "Reference devices": LEASES,
}
CODES = {code: text for group in GROUPS.values() for code, text in group.items()}


def address(code: str) -> str:
    """Where CODE is documented on this server: a problem's `type`. Raises KeyError for none of CODES."""
    if code not in CODES:
        raise KeyError(f"{code} is no code: add it to crowd/http/codes.py")
    return ADDRESS.format(code=code)
