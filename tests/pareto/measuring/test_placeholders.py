"""Placeholders of a command: filled, or refused before anything runs."""

import pytest

from pareto.errors import ScenarioError
from pareto.measuring.placeholders import Template
from tests.pareto.conftest import complaint, explore

NAMES = ["block", "threads/block", "a b", "Größe"]


@pytest.mark.parametrize(
    ("command", "filled"),
    [
        ("run {block} {config}", ["run", "32", '{"block": 32}']),
        ("run --size={block}x{block}", ["run", "--size=32x32"]),
        ("run '{a b}' {threads/block} {Größe}", ["run", "{block}", "8", "9"]),
        ("run {{block}} {{blok}}", ["run", "{block}", "{blok}"]),
        ("run ${block} ${HOME} ${block%.*}", ["run", "${block}", "${HOME}", "${block%.*}"]),
        ("run '{{block = 1}}' '{{ block }}'", ["run", "{block = 1}", "{ block }"]),
        ("""run '{"block": {block}}' '{blocks of 4}'""", ["run", '{"block": 32}', "{blocks of 4}"]),
        (
            """awk '{print $1}' '{"a": {}}' {a,b} {1..3}""",
            ["awk", "{print $1}", '{"a": {}}', "{a,b}", "{1..3}"],
        ),
    ],
)
def test_known_names_in_braces_are_filled_and_other_braces_are_text(command, filled):
    values = {"block": "32", "threads/block": "8", "a b": "{block}", "Größe": "9", "config": '{"block": 32}'}
    assert Template(command, NAMES).fill(values) == filled


def test_the_names_that_a_command_uses_are_known():
    assert Template("run {block} {{config}} x={a b}", NAMES).used == {"block"}
    assert Template("run {config}", NAMES).used == {"config"}


@pytest.mark.parametrize("command", ["run {blok}", "run --x={blok}.txt", "run {config} '{ {blok} }'"])
def test_an_unknown_placeholder_is_refused_with_the_known_ones(command):
    with pytest.raises(ScenarioError) as refused:
        Template(command, NAMES)
    message = str(refused.value)
    assert "unknown placeholder {blok}: did you mean {block}?" in message
    assert "{config}, {block}, {threads/block}" in message
    assert "write {{blok}} for the text itself" in message


@pytest.mark.parametrize(
    "braces",
    ["{block }", "{ block}", "{block!r}", "{block[0]}", "{block,2}", "{a b + 1}", "{Größe", "{config }"],
)
def test_malformed_braces_that_begin_with_a_known_name_are_refused(braces):
    with pytest.raises(ScenarioError, match="begins like a placeholder: write only the name") as refused:
        Template(f"run 'x={braces}'", NAMES)
    assert repr(braces) in str(refused.value)


def test_an_object_that_lost_its_quotes_to_the_shell_is_refused():
    with pytest.raises(ScenarioError, match=r"'\{block:', which begins like a placeholder"):
        Template('run {"block":{block}}', NAMES)


def test_a_command_with_an_unknown_placeholder_runs_nothing(toy, capsys):
    command = f"touch {toy}/ran {{X}}"
    assert explore(toy, "--budget", "3", source=["--command", command]) == 2
    error = complaint(capsys)
    assert "unknown placeholder {X}" in error
    assert "{config}, {x}, {mode}" in error
    assert not (toy / "ran").exists()
    assert not (toy / "out").exists()
