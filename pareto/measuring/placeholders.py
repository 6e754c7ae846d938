"""The arguments of a command, with placeholders for the values of a configuration."""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Iterable, Mapping

from pareto.errors import ScenarioError

CONFIG = "config"  # the configuration as JSON, even if a parameter has this name


class Template:
    """A command line, split as a shell would split it, in which `{name}` is replaced by a value.

    `{{name}}` stands for the text `{name}`, and `${name}` is left as it is, for a shell that the command may
    start. Other braces are text, such as those of `{"a": 1}`.

    Raises ScenarioError for a command that cannot be split, that is empty, that has a placeholder which is
    not one of `names`, or braces that begin with one of them and go on, as in `{name }` or `{name,2}`.
    """

    def __init__(self, command: str, names: Iterable[str]) -> None:
        self.names = tuple(dict.fromkeys([CONFIG, *names]))
        try:
            self.arguments = shlex.split(command)
        except ValueError as error:
            raise ScenarioError(f"--command {command!r}: {error}") from error
        if not self.arguments:
            raise ScenarioError("--command is empty")
        # The known names first, the longest of them first: a name may hold any character.
        alternatives = "|".join(re.escape(name) for name in sorted(self.names, key=len, reverse=True))
        word = rf"(?:{alternatives}|[^\W\d][\w.:/-]*)"
        more = rf"\s*(?:{alternatives})(?!\w)[^{{}}]*"
        self._pattern = re.compile(
            rf"\$\{{{word}\}}|\{{\{{(?P<text>{word}|{more})\}}\}}|\{{(?P<name>{word})\}}"
            rf"|(?<!\$)(?P<malformed>\{{{more}\}}?)"
        )
        for argument in self.arguments:
            for match in self._pattern.finditer(argument):
                self._require_known(match["name"])
                if match["malformed"]:
                    raise ScenarioError(
                        f"--command has {match['malformed']!r}, which begins like a placeholder: write only "
                        "the name in the braces, or double the braces for the text itself"
                    )

    @property
    def used(self) -> frozenset[str]:
        """The names that the command has a placeholder for."""
        names = (match["name"] for item in self.arguments for match in self._pattern.finditer(item))
        return frozenset(name for name in names if name)

    def fill(self, values: Mapping[str, str]) -> list[str]:
        """Return the arguments with the `values` in place of the names; braces in values mean nothing."""

        def replaced(match: re.Match[str]) -> str:
            if match["text"]:
                return "{" + match["text"] + "}"
            return values[match["name"]] if match["name"] else match[0]

        return [self._pattern.sub(replaced, argument) for argument in self.arguments]

    def _require_known(self, name: str | None) -> None:
        if name is None or name in self.names:
            return
        close = difflib.get_close_matches(name, self.names, n=1)
        hint = f"did you mean {{{close[0]}}}? " if close else ""
        raise ScenarioError(
            f"--command has an unknown placeholder {{{name}}}: {hint}Known are "
            f"{', '.join('{' + each + '}' for each in self.names)}; write {{{{{name}}}}} for the text "
            "itself"
        )
