"""Every answer that a program reads is the stored one.

`pytest tests/snapshots --write-snapshots` stores them again. Each difference is a line in CHANGELOG.md.
"""

import difflib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from django.db import transaction
from django.test import Client, override_settings
from django.urls import get_resolver

from crowd.http.codes import CODES
from tests.snapshots import plain
from tests.snapshots.database import fill
from tests.snapshots.fixed import world
from tests.snapshots.problems import NOT_ASKED, problems
from tests.snapshots.questions import Question, questions

STORED = Path(__file__).parent / "answers"
HEADERS = ("Content-Type", "Cache-Control", "Retry-After", "WWW-Authenticate", "Content-Disposition", "Allow")
# Addresses that answer with pages, with files by their digest, or with text for people.
PAGES = (
    "admin/",
    "guide/",
    "api/v1/docs",
    "healthz",
    "metrics",
    "sequences/",
    "trajectories/",
    "plans/",
    "shaders/",
    "^api/",
)


@dataclass
class Answers:
    """Snapshots by file; the calls (method, route) that were answered, and the codes of their problems."""

    snapshots: dict[str, list[Any]]
    calls: set[tuple[str, str]]
    codes: set[str]


def test_every_answer_is_the_stored_one(db: None, own_data_folder: Path, pytestconfig: pytest.Config) -> None:
    result = _answers(own_data_folder)

    texts = {f"{file}.json": f"{plain.lines(answers)}\n" for file, answers in result.snapshots.items()}
    if pytestconfig.getoption("--write-snapshots", default=False):
        _store(texts)
    assert _differences(texts) == []
    assert _calls() - result.calls == set()
    assert CODES.keys() - result.codes == NOT_ASKED.keys()


def _answers(folder: Path) -> Answers:
    result = Answers({}, set(), set())
    with world(folder) as fixed:
        site = fill(fixed, folder)
        fixed.begin("questions")  # however many random numbers were drawn before
        for question in (*questions(site), *problems(site)):
            fixed.begin(str(question))
            with transaction.atomic():
                response = _answer(question)
                snapshot = _snapshot(question, response)
                transaction.set_rollback(True)
            result.snapshots.setdefault(question.file, []).append(snapshot)
            if response.resolver_match is not None:
                result.calls.add((question.method, response.resolver_match.route))
            result.codes |= set(_codes(snapshot.get("answer")))
    return result


def _answer(question: Question) -> Any:
    with override_settings(**question.settings):
        for earlier in question.before:
            if isinstance(earlier, Question):
                _answer(earlier)
            else:
                earlier()
        body = b"" if question.body is None else question.body
        return Client().generic(
            question.method,
            question.path,
            body if isinstance(body, bytes) else json.dumps(body).encode(),
            content_type=question.headers.get("Content-Type", "application/json"),
            headers={"X-Request-Id": "snapshot", "Host": "testserver"} | question.headers,
        )


def _snapshot(question: Question, response: Any) -> dict[str, Any]:
    headers = {name: response.headers[name] for name in HEADERS if name in response.headers}
    body = plain.content(headers.get("Content-Type", ""), response.getvalue(), question.file)
    return {"request": str(question), "status": response.status_code, "headers": headers} | body


def _codes(answer: Any) -> Iterator[str]:
    """The codes of a problem and of the items in it."""
    if isinstance(answer, dict):
        if answer.get("code"):
            yield answer["code"]
        for item in answer.get("items", ()):
            yield from _codes(item)


def _calls() -> set[tuple[str, str]]:
    """Method and route of every call, table and file of the URL conf."""
    calls = set()
    for route, view in _routes(get_resolver().url_patterns):
        begins = route.startswith(("api/", "data/<str:name>/<", "readyz"))
        is_data = begins or route.endswith((".json", ".csv"))
        if is_data and not route.startswith(PAGES):
            kind = getattr(view, "view_class", None)
            methods = ("get", "post", "put", "patch", "delete") if kind else ("get",)
            calls |= {(name.upper(), route) for name in methods if kind is None or hasattr(kind, name)}
    return calls


def _routes(patterns: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    for pattern in patterns:
        route = f"{before}{pattern.pattern}"
        if hasattr(pattern, "url_patterns"):
            yield from _routes(pattern.url_patterns, route)
        else:
            yield route, pattern.callback


def _differences(texts: dict[str, str]) -> list[str]:
    """Lines in which `texts` differ from the stored files."""
    stored = {str(path.relative_to(STORED)): path.read_text() for path in STORED.rglob("*.json")}
    return [
        line
        for name in sorted(texts.keys() | stored.keys())
        for line in difflib.unified_diff(
            stored.get(name, "").splitlines(), texts.get(name, "").splitlines(), name, "now", n=2, lineterm=""
        )
    ]


def _store(texts: dict[str, str]) -> None:
    for path in STORED.rglob("*.json"):
        if str(path.relative_to(STORED)) not in texts:
            path.unlink()
    for name, text in texts.items():
        (STORED / name).parent.mkdir(parents=True, exist_ok=True)
        (STORED / name).write_text(text)
