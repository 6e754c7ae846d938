"""How far a measurement is, executed by Deno: the bar never goes back, repeated blocks have their time."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.client_kit.web.deno import DENO
from tests.client_kit.web.serving import WEB

RUNS, FRAMES = 8, 10
PROTOCOL = {"order": ["default", "best", "best", "default"], "repeats": 4}
SCRIPT = """
const { Course } = await import("%(module)s");
const course = new Course(%(protocol)s, 0);
const answers = %(messages)s.map((message, second) => ({
    ...course.at({ runs: %(runs)d, frames: %(frames)d, ...message }, second),
    again: course.again(message.run),
}));
console.log(JSON.stringify(answers));
"""


def course_of(folder: Path, messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What a course answers to `messages`, one a second."""
    script = folder / "course.js"
    values = {"module": (WEB / "course.js").as_uri(), "runs": RUNS, "frames": FRAMES}
    values |= {"protocol": json.dumps(PROTOCOL), "messages": json.dumps(messages)}
    script.write_text(SCRIPT % values, encoding="utf-8")
    ended = subprocess.run([DENO, "run", "--allow-read", script], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    answers: list[dict[str, Any]] = json.loads(ended.stdout)
    return answers


def passed(phase: str, configuration: str, run: int) -> list[dict[str, Any]]:
    return [
        {"phase": phase, "configuration": configuration, "run": run, "frame": frame}
        for frame in range(FRAMES + 1)
    ]


def block(first: int) -> list[dict[str, Any]]:
    return [
        message
        for number, name in enumerate(PROTOCOL["order"])  # type: ignore[arg-type]
        for message in passed("measuring", name, first + number)
    ]


def test_blocks_that_are_measured_again_have_their_part_of_the_bar_and_of_the_time(tmp_path: Path) -> None:
    planned = [*passed("checking", "default", 0), *passed("checking", "best", 0), *block(1), *block(5)]
    answers = course_of(tmp_path, [*planned, *block(9), *block(13)])

    shares = [answer["share"] for answer in answers]
    before, again = answers[: len(planned)], answers[len(planned) :]
    half = len(again) // 2
    assert shares == sorted(shares)
    assert before[-1]["share"] == pytest.approx(0.85)
    assert again[half - 1]["share"] == pytest.approx(0.925)
    assert shares[-1] == pytest.approx(1)
    assert all(answer["again"] is None for answer in before)
    assert [answer["again"]["run"] for answer in again[:: FRAMES + 1]] == [1, 2, 3, 4, 1, 2, 3, 4]
    assert before[-1]["seconds"] == again[half - 1]["seconds"] == again[-1]["seconds"] == 0
    assert again[0]["seconds"] == again[half]["seconds"] == 4 * FRAMES  # a frame takes a second
