"""The codes of all problems that the API reports. Problems, documentation and tests read this table.

Programs rely on a code. Its text may improve, its meaning never changes.
"""

from dataclasses import dataclass

from wire.protocol import MOST_RUNS, VERSION

TYPE_URI = "/api/v1/docs#code-{code}"
REJECTED_RUNS = 422


@dataclass(frozen=True)
class Code:
    """The HTTP status of a problem, and what to do about it.

    `of_a_run`: a single run of a submission can have this code. If all its runs have it, the status is
    REJECTED_RUNS.
    """

    status: int
    text: str
    of_a_run: bool = False

    @property
    def statuses(self) -> str:
        """All statuses that come with this code, such as "400 or 422"."""
        statuses = {self.status, REJECTED_RUNS} if self.of_a_run else {self.status}
        return " or ".join(map(str, sorted(statuses)))


# The request as a whole.
REQUEST = {
    "bad_request": Code(
        400, "The server does not serve this host or cannot read the request: check the address."
    ),
    "body_incomplete": Code(400, "The connection ended before the body did: send it again."),
    "body_too_large": Code(413, "The body has more bytes than the server takes: send fewer runs at once."),
    "body_too_slow": Code(408, "The body did not arrive in time: send it again on a better connection."),
    "damaged_gzip": Code(400, "Content-Encoding says gzip, the body is not whole gzip: compress it again."),
    "forbidden": Code(403, "You are not allowed to do this."),
    "inflated_too_large": Code(413, "The body inflates to far more than was sent: send fewer runs at once."),
    "invalid_cursor": Code(400, "The cursor is not valid, or its row is gone: start again without one."),
    "invalid_field": Code(
        400, "A member has the wrong type or a value out of range: `field` names it.", of_a_run=True
    ),
    "invalid_filter": Code(400, "A filter cannot be understood: `detail` says what would be right."),
    "invalid_limit": Code(400, "`limit` is not valid: give a whole number from 1 to 1000."),
    "length_required": Code(
        411, "Content-Length is not a number, or missing and the server cannot read chunks: send it."
    ),
    "malformed_json": Code(400, "The body is not JSON, or is nested too deeply.", of_a_run=True),
    "method_not_allowed": Code(405, "The address exists, the method does not: `Allow` names those that do."),
    "not_finite": Code(
        400, "NaN and infinite numbers are not JSON: write null, or leave the member out.", of_a_run=True
    ),
    "not_found": Code(404, "There is nothing at this address, or not for this token."),
    "null_character": Code(400, "A text holds the character NUL: leave it out."),
    "text_too_long": Code(400, "A text has more than 65536 bytes."),
    "too_many_values": Code(400, "The body has more than 160000 values: send fewer runs at once."),
    "unsupported_encoding": Code(415, "Send gzip, or no Content-Encoding."),
    "unsupported_media_type": Code(415, "Send Content-Type: application/json."),
}
# Authentication, rate limits and the state of the server.
ACCESS = {
    "app_outdated": Code(
        426, "This program is too old for the server: update it; `minimum_app_version` says to what."
    ),
    "busy": Code(503, "Too many requests wait: nothing was stored; wait as Retry-After says."),
    "consent_outdated": Code(400, "The participant agreed to another version of the text: ask again."),
    "daily_limit": Code(
        429, "The installation or its address sent as much as a day allows: wait as Retry-After says."
    ),
    "database_unavailable": Code(
        503, "The database does not answer: nothing was stored; wait as Retry-After says."
    ),
    "demo_server": Code(403, "A demo server takes no measurements: measure for another server."),
    "internal_error": Code(
        500, "The server failed and stored nothing: its log has the reason. Try again later."
    ),
    "not_accepting": Code(
        503, "No measurements are accepted now: keep them, and try again as Retry-After says."
    ),
    "server_busy": Code(503, "The server reads too many large bodies now: wait as Retry-After says."),
    "server_not_prepared": Code(
        503, "The server lacks tables or static files: its operator runs frontrunner admin prepare."
    ),
    "token_invalid": Code(401, "The token is unknown, was revoked or its data erased: get a new one."),
    "token_missing": Code(401, "Send Authorization: Bearer TOKEN."),
    "too_many_requests": Code(
        429, "A limit is reached: wait as Retry-After says; the RateLimit fields tell the limit."
    ),
}
# A submission as a whole.
SUBMISSION = {
    "all_runs_rejected": Code(
        REJECTED_RUNS, "No run can be taken, for different reasons: `items` tells each."
    ),
    "device_changed": Code(
        409, "The installation belongs to another device: enrol again for a second device."
    ),
    "device_too_deep": Code(400, "The device's description is nested too deeply."),
    "device_too_large": Code(400, "The device's description takes too many bytes."),
    "extra_too_deep": Code(
        400, "Members that this version does not know are nested too deeply.", of_a_run=True
    ),
    "extra_too_large": Code(
        400, "Members that this version does not know take too many bytes.", of_a_run=True
    ),
    "idempotency_key_missing": Code(
        400, "Send Idempotency-Key: 1 to 128 printable characters, new for each body."
    ),
    "idempotency_key_reused": Code(
        409, "This key came with another body before: use a new key for a new body."
    ),
    "personal_data": Code(400, "A member's name could identify a person: leave it out.", of_a_run=True),
    "run_count": Code(400, f"A submission has 1 to {MOST_RUNS} runs: split it."),
    "unknown_schema_version": Code(400, "This server reads schema_version 1."),
}
# One run. Each run of a submission is checked separately.
RUN = {
    name: Code(REJECTED_RUNS, text, of_a_run=True)
    for name, text in {
        "deviation_missing": "Send each ok run's largest distance from the reference trajectory.",
        "error_contradicts_deviation": "With the first pose laid on the first true one, an error differs "
        "from that of the reference trajectory by at most twice the deviation.",
        "errors_out_of_order": "The mean of the errors is at most their rmse, and that at most the largest.",
        "empty_frame_missing": "Send what an empty frame costs on the session's backend.",
        "frame_count": "A run has one value a frame: as many as the protocol says unless it failed.",
        "negative_error": "An error is a distance in metres: 0 or more.",
        "negative_time": "A time is 0 microseconds or more.",
        "processor_time_too_large": "The threads of a run computed for longer than all processors did.",
        "repeat_taken": "This repeat of the configuration is there already, under another id.",
        "session_taken": "Another session has this id: use a new one.",
        "stage_clock_missing": "Send what took the times of the stages: device, wall or none.",
        "stages_without_clock": "Nothing measured the stages, says `stage_clock`: send runs without them.",
        "threads_missing": "With the backend wasm, send how many `threads` computed: 1 to 64.",
        "threads_without_wasm": "Only the backend wasm has `threads`: leave them out.",
        "time_too_large": "A frame takes at most 60 seconds: 60000000 microseconds.",
        "too_many_repeats": "The protocol fixes the repeats of each configuration: send no more.",
        "too_many_samples": "A session has at most one sample a second, and none after its end.",
        "too_many_stages": "A run has 16 stages at most.",
        "unknown_configuration": "The front has no configuration of this name.",
        "unknown_front_version": "No front of this name is published here: read the manifest again.",
        "unknown_protocol_version": f"This server takes sessions of protocol {VERSION}: read "
        "the manifest again.",
        "zero_time": "Every counted frame took 0 microseconds: the clock did not run.",
    }.items()
}
# Reading.
READING = {
    "export_in_preparation": Code(
        503, "The files of the open data are being written: wait as Retry-After says."
    ),
    "export_removed": Code(410, "Only releases are kept: `detail` names the one that contains this export."),
    "files_unavailable": Code(503, "The bucket with this file does not answer: wait as Retry-After says."),
    "front_outdated": Code(
        404, "The front was prepared with an earlier program: its administrator must prepare it again."
    ),
    "no_front": Code(404, "No front of this application is published here."),
}
# Reference devices.
LEASES = {
    "another_device": Code(403, "The token belongs to another reference device."),
    "another_result": Code(409, "The lease is finished with another result: drop this one."),
    "device_set_aside": Code(403, "Answers of this device contradict: ask an administrator."),
    "lease_gone": Code(410, "Another machine has the evaluation now, or it was cancelled: drop the result."),
    "client_outdated": Code(409, "Send lease_version 2: a client that does not is too old, update it."),
    "sequence_missing": Code(
        409, "The server lacks the sequence of what waits: its administrator must add it."
    ),
}
GROUPS: dict[str, dict[str, Code]] = {
    "Any request": REQUEST,
    "Access, limits and the server's state": ACCESS,
    "A whole submission": SUBMISSION,
    "One run": RUN,
    "Reading": READING,
    "Reference devices": LEASES,
}
CODES = {name: code for group in GROUPS.values() for name, code in group.items()}


def type_uri(code: str) -> str:
    """The `type` of a problem: where this server documents `code`. Raises KeyError for an unknown code."""
    if code not in CODES:
        raise KeyError(f"{code} is not a code: add it to crowd/http/codes.py")
    return TYPE_URI.format(code=code)
