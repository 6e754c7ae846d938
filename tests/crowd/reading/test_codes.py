"""Every code of a problem is documented."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from django.test import Client

from crowd.http import codes
from crowd.http.problems import Problem

ROOT = Path(__file__).resolve().parents[3]


def refusals(*names: str) -> Iterator[tuple[str, str]]:
    """The literal code of each call of `names` (Problem, Rejection) in the sources, with its position."""
    for name, code, position in calls():
        if name in names:
            yield code, position


@cache
def calls() -> list[tuple[str, str, str]]:
    """The calls in the sources by a name: it, the literal that is their first argument, and where."""
    return [
        (node.func.id, str(node.args[0].value), f"{path.relative_to(ROOT)}:{node.lineno}")
        for path in sorted((ROOT / "crowd").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        if node.args and isinstance(node.args[0], ast.Constant)
    ]


@pytest.mark.slow
def test_every_code_in_the_sources_is_registered_and_no_other_is() -> None:
    found = list(refusals("Problem", "Rejection"))

    assert len(found) > 40
    assert [position for code, position in found if code not in codes.CODES] == []
    assert codes.CODES.keys() - {code for code, _ in found} == set()


@pytest.mark.slow
def test_the_code_of_a_rejected_run_is_registered_as_one() -> None:
    found = list(refusals("Rejection"))

    assert len(found) > 10
    assert [position for code, position in found if not codes.CODES[code].of_a_run] == []


def test_a_code_determines_the_status_of_a_problem() -> None:
    assert Problem("not_found", "no such device").response().status_code == 404
    assert Problem("invalid_field", "wrong", status=codes.REJECTED_RUNS).response().status_code == 422


def test_a_code_of_a_run_says_that_all_runs_may_have_it() -> None:
    assert codes.CODES["not_found"].statuses == "404"
    assert codes.CODES["zero_time"].statuses == "422"
    assert codes.CODES["invalid_field"].statuses == "400 or 422"


def test_a_problems_type_leads_to_its_code_on_the_docs_page(client: Client, db: None) -> None:
    problem = client.get("/api/v1/devices/none").json()
    path, _, anchor = problem["type"].partition("#")
    page = client.get(path)

    assert page.status_code == 200
    assert anchor == "code-not_found"
    for code in codes.CODES:
        assert page.content.decode().count(f'id="code-{code}"') == 1
    assert "<code>not_found</code> <small>404</small>" in page.content.decode()


def test_a_code_that_is_nowhere_documented_is_refused() -> None:
    with pytest.raises(KeyError, match="made_up is not a code"):
        Problem("made_up", "text")
