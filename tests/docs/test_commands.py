"""Every command, option, file and variable that a page names exists."""

import argparse
import re
import shlex
import subprocess
from functools import cache
from pathlib import Path

import pytest
from django.core.management import load_command_class

from client_kit import cli_options
from frontrunner.__main__ import COMMANDS
from frontrunner.paper import command as paper
from frontrunner.worker import make_parser as worker_parser
from pareto.cli import commands as tune
from slam.__main__ import make_parser
from tests.docs import pages

PAGES = pages.manual()
START = re.compile(
    r"\s*(?:\S+=\S+\s+)*"
    r"(?:\S*python3? (?:-m (frontrunner|client_kit|pareto|slam)|(manage\.py))|(frontrunner))(?=\s|$)(.*)"
)
VARIABLE = "FRONTRUNNER_[A-Z_]+[A-Z]"
PROGRAMS = {"client_kit": "measure", "pareto": "tune", "slam": "slam"}


def called(page: Path) -> list[list[str]]:
    """The words after `frontrunner` of every command in `page`, however it is started."""
    found = []
    for line in pages.code(page.read_text(encoding="utf-8")).splitlines():
        line = re.sub(r"\s#\s.*$|[|;&>].*$", "", line)
        starts = START.match(line)
        if not starts:
            continue
        try:
            words = shlex.split(starts[4])
        except ValueError:
            words = starts[4].split()
        first = [PROGRAMS[starts[1]]] if starts[1] in PROGRAMS else ["admin"] if starts[2] else []
        found.append([*first, *words])
    return found


def parser_of(words: list[str]) -> tuple[argparse.ArgumentParser, list[str]]:
    """The parser of the program that `words` start, and the words that it reads."""
    program, *rest = words
    if program == "slam":
        return make_parser(), rest
    if program == "worker":
        return worker_parser(), rest
    if program == "paper":
        return paper.make_parser("paper"), rest
    if program == "tune":
        return tune.make_parser(rest[:1], "tune"), rest
    if program in ("measure", "doctor"):
        parser = cli_options.parser()
        if program == "doctor":
            return parser, ["doctor", *rest]
        return parser, rest if rest and rest[0] in choices(parser) else ["run", *rest]
    name, rest = ("serve", rest) if program == "serve" else (rest[0], rest[1:])
    from django.core.management import get_commands

    home = get_commands()[name]
    assert isinstance(home, str)
    return load_command_class(home, name).create_parser("admin", name), rest


def choices(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_and_option_exists(page: Path) -> None:
    for words in called(page):
        if not words or words[0] in ("--version", "--help", "COMMAND"):
            continue
        assert words[0] in COMMANDS, words
        if len(words) == 1 and words[0] not in ("measure", "doctor", "serve"):
            continue
        parser, rest = parser_of(words)
        while choices(parser) and rest and not rest[0].startswith("-"):
            assert rest[0] in choices(parser), words
            parser, rest = choices(parser)[rest[0]], rest[1:]
        for option in rest:
            if re.match(r"--[a-z]", option):
                assert option.split("=")[0] in parser._option_string_actions, words


def test_the_commands_are_found() -> None:
    """The test above looks at many: the pages show them in the form that it reads."""
    assert sum(len(called(page)) for page in PAGES) > 80


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_file_of_the_project_exists(page: Path) -> None:
    tracked = subprocess.run(["git", "ls-files"], cwd=pages.ROOT, capture_output=True, text=True, check=False)
    if tracked.returncode:
        pytest.skip("not a git checkout")
    roots = {name.split("/")[0] for name in tracked.stdout.splitlines() if "/" in name}
    built = {"frontrunner/guide"}
    for name in re.findall(r"`([\w.-]+/[\w./-]+)`", page.read_text(encoding="utf-8")):
        if name.split("/")[0] in roots and name not in built:
            assert (pages.ROOT / name).exists(), name


@cache
def variables() -> set[str]:
    """Those that a program or a test reads."""
    return {
        name
        for folder in ("crowd", "client_kit", "slam", "frontrunner", "tests")
        for path in (pages.ROOT / folder).rglob("*.py")
        for name in re.findall(rf"""["']({VARIABLE})["']""", path.read_text(encoding="utf-8"))
    }


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_variable_is_read_somewhere(page: Path) -> None:
    assert set(re.findall(rf"\b{VARIABLE}\b", page.read_text(encoding="utf-8"))) <= variables()


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_every_link_of_a_page_outside_the_guide_leads_to_a_file(name: str) -> None:
    links = re.findall(r"\]\(([^)#]+)", pages.FENCE.sub("", (pages.ROOT / name).read_text(encoding="utf-8")))

    assert [link for link in links if "://" not in link and not (pages.ROOT / link).exists()] == []


def test_pictures_are_small_and_used() -> None:
    pictures = [*pages.DOCS.glob("pictures/*"), *pages.DOCS.glob("research/pictures/*")]
    texts = "".join(page.read_text(encoding="utf-8") for page in [*PAGES, *pages.research()])

    assert sum(path.stat().st_size for path in pictures) < 2_000_000
    for path in pictures:
        assert path.stat().st_size < 150_000, path
        assert f"pictures/{path.name}" in texts, path
