"""A directive for Sphinx: the help texts of every command, as the programs print them.

```{command-reference} measure
```
"""

import argparse
import os
import re
from collections.abc import Iterator

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

DJANGOS_OPTIONS = frozenset(
    ("version", "verbosity", "settings", "pythonpath", "traceback", "no_color", "force_color", "skip_checks")
)


def commands(program: str) -> Iterator[tuple[str, str]]:
    """Each command of `program` with its help text: `frontrunner measure run` and so on."""
    readers = {
        **{"measure": _measure, "tune": _tune, "worker": _worker, "slam": _slam, "paper": _paper},
        **{"serve": _serve, "admin": _admin},
    }
    for name, parser in readers[program]():
        yield name, re.sub(r"[ \t]+$", "", parser.format_help(), flags=re.MULTILINE)


def _measure() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    from client_kit import cli_options

    yield from _leaves("frontrunner measure", cli_options.parser("frontrunner measure"))


def _tune() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    from pareto.cli import commands

    for word in commands.COMMANDS:
        whole = commands.make_parser([word], "frontrunner tune")
        yield f"frontrunner tune {word}", _choices(whole)[word]


def _worker() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    from frontrunner.worker import make_parser

    yield "frontrunner worker", make_parser()


def _slam() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    from slam.__main__ import make_parser

    yield from _leaves("frontrunner slam", make_parser("frontrunner slam"))


def _paper() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    from frontrunner.paper.command import make_parser

    yield "frontrunner paper", make_parser("frontrunner paper")


def _serve() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield from _of_django("frontrunner", "serve", _own_commands()["serve"])


def _admin() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    for name, home in sorted(_own_commands().items()):
        if name not in ("flush", "serve"):
            yield from _of_django("frontrunner admin", name, home)


def _own_commands() -> dict[str, str]:
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")
    import django
    from django.core.management import get_commands

    django.setup()
    return {name: home for name, home in get_commands().items() if home.startswith("crowd.")}


def _of_django(program: str, name: str, home: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    from django.core.management import load_command_class

    parser = load_command_class(home, name).create_parser(program, name)
    _hide_djangos_options(parser)
    yield from _leaves(f"{program} {name}", parser)


def _hide_djangos_options(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        if action.dest in DJANGOS_OPTIONS:
            action.help = argparse.SUPPRESS


def _choices(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def _leaves(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The commands below `parser`, or `parser` itself where there are none."""
    below = _choices(parser)
    if not below:
        yield name, parser
    for word, command in below.items():
        yield from _leaves(f"{name} {word}", command)


class CommandReference(Directive):
    """A section for each command of one program."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        sections: list[nodes.Node] = []
        for name, text in commands(self.arguments[0]):
            section = nodes.section(ids=[nodes.make_id(name)], names=[name])
            section += nodes.title(name, name)
            section += nodes.literal_block(text, text, language="text")
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("command-reference", CommandReference)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
