"""Every run and session that cannot be right is its own clear problem, and leaves nothing behind."""

import json
from typing import Any

import pytest

from crowd.fronts.publishing.services import publish_content
from crowd.results.models import Run
from tests.builders.crowds import Join, send
from tests.builders.documents import (
    FRAMES,
    device_document,
    front_document,
    run_document,
    session_document,
    submission_document,
    wasm_session,
)
from tests.builders.participant import Participant
from tests.crowd.refusals import nothing_is_stored, only, problem

INVALID, NEITHER = "invalid_field", "unknown_front_version"
TOO_LONG = [2**32] * FRAMES
# What is wrong in the only run of a submission, and the code and the field of the refusal.
RUNS: list[tuple[dict[str, Any], str, str]] = [
    ({"frame_us": "fast"}, INVALID, "frame_us"),
    ({"repeat": "first"}, INVALID, "repeat"),
    ({"id": "not a UUID"}, INVALID, "id"),
    ({"status": "great"}, INVALID, "status"),
    ({"ate_max": "small"}, INVALID, "ate_max"),
    ({"frame_us": [1000] * 7 + [-1] + [1000] * 92}, "negative_time", "frame_us"),
    ({"stages_us": {"tracking": [-1] + [10] * 99}}, "negative_time", "stages_us.tracking"),
    *(({"frame_us": [1000] * frames}, "frame_count", "frame_us") for frames in (0, 99, 101)),
    ({"frame_us": TOO_LONG}, "time_too_large", "frame_us"),
    ({"frame_us": [0] * FRAMES, "stages_us": {}}, "zero_time", "frame_us"),
    ({"ate_max": -0.01}, "negative_error", "ate_max"),
    ({"ate_mean": 0.0095}, "errors_out_of_order", "ate_mean"),
    ({"ate_rmse": 0.0125}, "errors_out_of_order", "ate_rmse"),
    ({"ate_rmse": None, "ate_mean": 0.0125}, "errors_out_of_order", "ate_mean"),
    ({"configuration": "fastest"}, "unknown_configuration", "configuration"),
]
# What is wrong in the only session: status, code and field.
SESSIONS: list[tuple[dict[str, Any], int, str, str]] = [
    ({"samples": [{"t": -1.0}]}, 400, INVALID, "samples[0].t"),
    *(({"backend": name}, 400, INVALID, "backend") for name in ("neon", "OpenCL", "buy-my-phone", "")),
    ({"started_at": "2026-11-20T10:17:00"}, 400, INVALID, "started_at"),
    ({"started_at": "0001-01-01T00:00:00+12:00"}, 422, INVALID, "started_at"),
    ({"started_at": "9999-12-31T23:59:59-12:00"}, 422, INVALID, "started_at"),
    *(({"empty_frame_us": wrong}, 400, INVALID, "empty_frame_us") for wrong in (-1, 60_000_001, "quick")),
    ({"empty_frame_us": 10**400}, 400, "not_finite", "empty_frame_us"),
    ({"empty_frame_us": None}, 422, "empty_frame_missing", "empty_frame_us"),
    ({"stage_clock": "gpu"}, 400, INVALID, "stage_clock"),
    ({"stage_clock": None}, 422, "stage_clock_missing", "stage_clock"),
    ({"front_version": "kfusion-99"}, 422, NEITHER, "front_version"),
    ({"application": "elasticfusion"}, 422, NEITHER, "front_version"),
    *(
        ({"protocol_version": other}, 422, "unknown_protocol_version", "protocol_version")
        for other in (0, 1, 3, 7)
    ),
    *(
        (wasm_session(threads=wrong), 400, INVALID, "threads")
        for wrong in (0, 65, -1, 2.5, "2", True)
    ),
    (wasm_session(threads=None), 422, "threads_missing", "threads"),
    *(
        ({"backend": name, "threads": 1}, 422, "threads_without_wasm", "threads")
        for name in ("opencl", "webgpu", "cpu")
    ),
    *(
        ({"samples": [{"t": t} for t in times]}, 422, "too_many_samples", "samples")
        for times in ([3.0] * 5_000, [0.5 * number for number in range(20)], [0.0, 0.0, 0.0])
    ),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "code", "field"), RUNS)
def test_a_wrong_run_is_named(
    participant: Participant, changes: dict[str, Any], code: str, field: str
) -> None:
    response = participant.submit(only(run_document("best", 0, 0, 1000) | changes))

    assert problem(response) == (422, code, f"sessions[0].runs[0].{field}")
    assert code != "unknown_configuration" or "accurate, best, default" in response.json()["detail"]
    assert nothing_is_stored()


@pytest.mark.parametrize(("changes", "status", "code", "field"), SESSIONS)
def test_a_wrong_session_is_named(
    participant: Participant, changes: dict[str, Any], status: int, code: str, field: str
) -> None:
    response = participant.submit(submission_document(session_document(**changes)))

    assert problem(response) == (status, code, f"sessions[0].{field}")
    if status == 422:
        assert [(item["status"], item["code"]) for item in response.json()["items"]] == [
            ("rejected", code)
        ] * 4
    assert nothing_is_stored()


@pytest.mark.parametrize(
    ("member", "code"),
    [
        ("empty_frame_us", "empty_frame_missing"),
        ("stage_clock", "stage_clock_missing"),
        ("threads", "threads_missing"),
    ],
)
def test_a_member_that_is_absent_is_named(participant: Participant, member: str, code: str) -> None:
    session = session_document() if member != "threads" else wasm_session()
    del session[member]

    response = participant.submit(submission_document(session))

    assert problem(response) == (422, code, f"sessions[0].{member}")
    assert nothing_is_stored()


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_json_does_not_have(participant: Participant, number: str) -> None:
    body = json.dumps(submission_document()).replace("0.012", number, 1)

    assert problem(participant.submit(body.encode())) == (400, "not_finite", None)
    assert nothing_is_stored()


# A number in the first run, what is written instead, and the codes of the four runs.
WRONG_NUMBERS = {
    "an infinite error": ('"ate_max": 0.012', '"ate_max": 1e999', ["not_finite"]),
    "an infinite deviation": ('"deviation": 0.0005', '"deviation": 1e999', ["not_finite"]),
    "a member of another year": ('"ate_max": 0.012', '"ate_max": 0.012, "later": 1e999', ["not_finite"]),
    "a whole number beyond reason": ('"repeat": 0', f'"repeat": {"9" * 5_000}', [INVALID, INVALID]),
}


@pytest.mark.parametrize(("number", "other", "codes"), WRONG_NUMBERS.values(), ids=WRONG_NUMBERS)
def test_a_number_beyond_reason_costs_only_its_run(
    participant: Participant, number: str, other: str, codes: list[str]
) -> None:
    """An infinite one is replaced in the first run, and a repeat in the first of each configuration."""
    session = session_document()
    body = json.dumps(submission_document(session)).replace(number, other, 1 if len(codes) == 1 else -1)

    items = participant.submit(body.encode()).json()["items"]

    assert [item["code"] for item in items] == [*codes, *[None] * (4 - len(codes))]
    assert [item["id"] for item in items] == [run["id"] for run in session["runs"]]


@pytest.mark.parametrize("member", ["frame_us", "stages_us"])
def test_a_frame_takes_at_most_a_minute(participant: Participant, member: str) -> None:
    longest, longer = ([60_000_000 + more] + [1000] * 99 for more in (0, 1))
    taken = run_document("best", 0, 0, 1000, frame_us=longest, stages_us={"tracking": longest})
    refused = run_document("best", 1, 1, 1000)
    refused[member] = longer if member == "frame_us" else {"tracking": longer}

    items = send(participant, session_document(runs=[taken, refused])).json()["items"]

    assert [item["code"] for item in items] == [None, "time_too_large"]


def test_known_backends_are_taken(participant: Participant) -> None:
    for backend in ("opencl", "webgpu", "wasm", "vulkan", "metal", "cuda", "cpu"):
        send(participant, session_document(backend=backend, threads=1 if backend == "wasm" else None))


@pytest.mark.parametrize(
    ("cores", "cpu_us", "code"),
    [
        ("2", 3_000_000, None),
        ("2", 4_000_000, "processor_time_too_large"),
        ("4", 4_000_000, None),
        (None, 4_000_000, None),
        ("many", 4_000_000, None),
        ("2", None, None),
    ],
)
def test_threads_compute_no_longer_than_all_processors(
    participant: Participant, cores: str | None, cpu_us: int | None, code: str | None
) -> None:
    """90 frames of 10 ms are 0.9 s on each; as much again for what is done between frames."""
    taken, asked = run_document("best", 0, 0, 10_000), run_document("best", 1, 1, 10_000, cpu_us=cpu_us)
    described = device_document(cpu_count=cores)

    response = participant.submit(
        submission_document(session_document(runs=[taken, asked]), device=described)
    )

    assert [item["code"] for item in response.json()["items"]] == [None, code]


def test_no_runs_and_too_many(participant: Participant) -> None:
    many = [run_document("best", n, n, 1000, stages_us={}) for n in range(51)]
    for runs in ([], many):
        response = participant.submit(submission_document(session_document(runs=runs)))
        assert problem(response) == (400, "run_count", "sessions")
    assert nothing_is_stored()


def test_two_runs_that_claim_one_repeat(participant: Participant) -> None:
    session = session_document()
    again = run_document("best", 1, 4, 1)

    items = send(participant, session | {"runs": [*session["runs"], again]}).json()["items"]
    response = participant.submit(submission_document(session | {"runs": [again]}))

    assert [item["code"] for item in items] == [None, None, None, None, "repeat_taken"]
    assert problem(response)[:2] == (422, "repeat_taken")
    assert Run.objects.count() == 4


def test_a_session_of_somebody_else(participant: Participant, join: Join) -> None:
    session = session_document()
    send(participant, session)

    response = join().submit(submission_document(session | {"runs": [run_document("best", 1, 5, 1)]}))

    assert problem(response)[:2] == (422, "session_taken")
    assert Run.objects.count() == 4


@pytest.mark.parametrize("together", [True, False])
@pytest.mark.parametrize(
    ("first", "later"),
    [
        ({}, {"front_version": "kfusion-second"}),
        ({}, {"backend": "vulkan"}),
        ({"backend": "wasm", "threads": 4}, {"threads": 1}),
        ({"stage_clock": "none"}, {"stage_clock": "wall"}),
    ],
)
def test_all_parts_of_a_session_have_one_front_and_measure_alike(
    participant: Participant,
    pack: dict[str, Any],
    first: dict[str, Any],
    later: dict[str, Any],
    together: bool,
) -> None:  # fmt: skip
    """Within one request as between two: runs of a session are compared with each other."""
    publish_content(front_document(pack, "second"))
    session = session_document(**first)
    if first.get("stage_clock") == "none":
        session["runs"] = [run | {"stages_us": None} for run in session["runs"]]
    parts = [session | {"runs": session["runs"][:2]}, session | {"runs": session["runs"][2:]} | later]

    requests = [parts] if together else [[part] for part in parts]
    answers = [participant.submit(submission_document(*sessions)).json() for sessions in requests]

    items = [item for answer in answers for item in answer["items"]]
    assert [item["code"] for item in items] == [None, None, "session_taken", "session_taken"]
    member = "id" if later.keys() & {"front_version", "backend"} else next(iter(later))
    assert items[-1]["field"] == f"sessions[{1 if together else 0}].{member}"
    assert Run.objects.count() == 2
    assert participant.get("/speedups?since=2020-01-01").status_code == 200


def test_a_session_that_is_refused_takes_no_id(participant: Participant) -> None:
    session = session_document()

    answer = send(participant, session | {"front_version": "kfusion-none"}, session)

    assert [item["code"] for item in answer.json()["items"]] == ["unknown_front_version"] * 4 + [None] * 4
    assert Run.objects.count() == 4
