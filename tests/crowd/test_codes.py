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
    for path in sorted((ROOT / "crowd").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            name = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            if name not in PLACES:
                continue
            assert isinstance(node, ast.Call)
            argument = node.args[PLACES[name]]
            if isinstance(argument, ast.Constant):
                yield str(argument.value), f"{path.relative_to(ROOT)}:{node.lineno}"


def test_every_code_in_the_sources_is_registered() -> None:
    found = list(literal_codes())

    assert len(found) > 40
    assert [place for code, place in found if code not in codes.CODES] == []


def test_no_code_is_registered_that_nothing_answers() -> None:
    assert codes.CODES.keys() - {code for code, _ in literal_codes()} == set()


def test_a_problems_type_leads_to_its_code_on_the_docs_page(client: Client, db: None) -> None:
    problem = client.get("/api/v1/devices/none").json()
    path, _, anchor = problem["type"].partition("#")
    page = client.get(path)

    assert page.status_code == 200
    assert anchor == "code-not_found"
    for code in codes.CODES:
        assert page.content.decode().count(f'id="code-{code}"') == 1


def test_a_code_that_is_nowhere_documented_is_refused() -> None:
    with pytest.raises(KeyError, match="made_up is no code"):
        Problem(400, "made_up", "text")
