"""The examples of docs/tune/spaces.md are what happens."""

import ast
import json
import re
from pathlib import Path

import pytest

from pareto.spaces.constraint import Constraint
from pareto.spaces.parameter import Parameter
from pareto.spaces.space import Space

PAGE = (Path(__file__).parents[3] / "docs" / "tune" / "spaces.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    return "\n".join(re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL))


def test_the_example_gives_the_values_that_its_comments_name(tmp_path, monkeypatch):
    (tmp_path / "convolution.json").write_text(block("json"))
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    compared = 0
    source = block("python")
    for node in ast.parse(source).body:
        code = ast.get_source_segment(source, node)
        comment = source.splitlines()[node.end_lineno - 1].partition("#")[2]
        if not comment:
            exec(code, names)
            continue
        expected = re.match(r"\s*(\[.*?\]|\{.*?\}|'.*?'|\d+|True)", comment)
        assert expected, code
        assert eval(code, names) == ast.literal_eval(expected[1]), code
        compared += 1
    assert compared == 9


@pytest.mark.parametrize(
    "row", re.findall(r"^\| .*? \| (`.*`) \|$", PAGE.split("## Constraints")[1], re.MULTILINE)
)
def test_every_example_of_a_constraint_is_understood(row):
    parameters = Space.from_dict(json.loads(block("json"))).parameters
    threads = Parameter("threads/block", "ordinal", (128, 256), 128)
    text = row.removeprefix("`` ").removesuffix(" ``") if row.startswith("``") else row.strip("`")
    assert Constraint(text, (*parameters, threads)).names


def test_there_are_six_examples_of_constraints():
    assert len(re.findall(r"^\| .*? \| (`.*`) \|$", PAGE.split("## Constraints")[1], re.MULTILINE)) == 6
