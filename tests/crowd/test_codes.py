"""Every code that the server can answer is documented, where problems say and where people read."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from django.test import Client

from crowd.http import codes
from crowd.http.problems import Problem

ROOT = Path(__file__).resolve().parents[2]
# Which argument of each refusal is its code.
PLACES = {"Problem": 1, "Rejection": 0}


def literal_codes() -> Iterator[tuple[str, str]]:
    """Every code written out in the sources, with the place."""
    for code, _, place in refusals():
        yield code, place


def refusals() -> Iterator[tuple[str, str, str]]:
    """Every refusal in the sources whose code is written out: the code, its status, "" for one run's, and the
    place.
    """
    for path in sorted((ROOT / "crowd").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            name = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            if name not in PLACES:
                continue
            assert isinstance(node, ast.Call)
            argument = node.args[PLACES[name]]
            if isinstance(argument, ast.Constant):
                status = ast.unparse(node.args[0]) if name == "Problem" else ""
                yield str(argument.value), status, f"{path.relative_to(ROOT)}:{node.lineno}"


def test_every_code_in_the_sources_is_registered() -> None:
    found = list(literal_codes())

    assert len(found) > 40
    assert [place for code, place in found if code not in codes.CODES] == []


def test_no_code_is_registered_that_nothing_answers() -> None:
    assert codes.CODES.keys() - {code for code, _ in literal_codes()} == set()


def test_every_code_is_answered_with_its_status() -> None:
    for code, status, place in refusals():
        known = codes.CODES[code]
        if status:
            named = "REJECTED_RUNS" if known.status == codes.REJECTED_RUNS else str(known.status)
            # What else Django REST framework refuses has its own status.
            assert status in (named, "error.status_code"), place
        else:
            assert known.of_a_run, place


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
        Problem(400, "made_up", "text")
