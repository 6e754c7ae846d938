"""Depth, values and texts of JSON are counted as a plain walk over its characters counts them."""

import json
import random
from typing import Any

import pytest

from crowd.http import json_limits
from crowd.http.problems import Problem


def walk(body: bytes) -> tuple[int, int, int]:
    """Depth, number of values and longest text of `body`, byte by byte."""
    depth = deepest = values = longest = 0
    start: int | None = None
    escaped = False
    for place, character in enumerate(body.decode("latin-1")):
        if start is not None:
            if escaped:
                escaped = False
            elif character == "\\":
                escaped = True
            elif character == '"':
                longest, start = max(longest, place - start), None
        elif character == '"':
            start = place
        elif character in "[{":
            depth, values = depth + 1, values + 1
            deepest = max(deepest, depth)
        elif character in "]}":
            depth -= 1
        elif character in ",:":
            values += 1
    return deepest, values, longest


def value(random: random.Random, depth: int = 0) -> Any:
    """Any JSON, with texts that look like structure."""
    kind = random.random()
    if depth < 4 and kind < 0.3:
        return [value(random, depth + 1) for _ in range(random.randint(0, 5))]
    if depth < 4 and kind < 0.6:
        return {text(random): value(random, depth + 1) for _ in range(random.randint(0, 5))}
    return random.choice([1, None, True, 1.5e-3, text(random)])


def text(random: random.Random) -> str:
    return "".join(random.choices('ab"\\[]{},:é', k=random.randint(0, 6)))


LIMITS = {"MAX_DEPTH": "malformed_json", "MAX_VALUES": "too_many_values", "MAX_TEXT_BYTES": "text_too_long"}


@pytest.mark.slow
@pytest.mark.parametrize("block", [1, 2, 3, 7, 64])
def test_the_scan_counts_as_a_walk_does_wherever_its_blocks_end(
    monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(json_limits, "BLOCK", block)
    source = random.Random(block)
    for _ in range(60):
        body = json.dumps(value(source), ensure_ascii=source.random() < 0.5).encode()
        counted = dict(zip(LIMITS, walk(body), strict=True))
        for name, most in counted.items():
            monkeypatch.setattr(json_limits, name, most)
        json_limits.check(body)
        for name, most in counted.items():
            if most:
                monkeypatch.setattr(json_limits, name, most - 1)
                with pytest.raises(Problem) as refused:
                    json_limits.check(body)
                assert refused.value.code == LIMITS[name]
                monkeypatch.setattr(json_limits, name, most)


@pytest.mark.parametrize("body", [b"", b'"', b'"\\', b"\\", b"]]]]", b'{"a', b'[[["', b"\xff\xfe"])
def test_what_is_not_json_passes_the_scan(body: bytes) -> None:
    """The decoder refuses it, and says why."""
    json_limits.check(body)
