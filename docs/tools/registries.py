"""Directives for Sphinx that print a registry of the source as a table: what is written once cannot differ.

```{error-codes}
```
```{validity-rules}
```
"""

import os
from collections.abc import Iterator

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx


class Table(Directive):
    """Markdown that a subclass writes, read as a part of the page."""

    def lines(self) -> Iterator[str]:
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        container = nodes.container()
        self.state.nested_parse(StringList(list(self.lines()), "registry"), self.content_offset, container)
        return list(container.children)


class ErrorCodes(Table):
    """Every code of a refusal, in its group."""

    def lines(self) -> Iterator[str]:
        from crowd.http import codes

        for group, found in codes.GROUPS.items():
            yield from (
                f"**{group}**",
                "",
                "| code | status | what it means, and what to do |",
                "|---|---|---|",
            )
            yield from (f"| `{name}` | {code.statuses} | {code.text} |" for name, code in found.items())
            yield ""


class ValidityRules(Table):
    """Every rule that decides whether a run or session counts, the first that applies on top."""

    def lines(self) -> Iterator[str]:
        os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")
        import django

        django.setup()
        from crowd.results.validity.rules import RULES

        yield from ("| code | state | looks at | threshold | meaning |", "|---|---|---|---|---|")
        for rule in RULES.values():
            threshold = "" if rule.threshold is None else f"{rule.threshold:g}"
            yield f"| `{rule.code}` | {rule.state} | {rule.level} | {threshold} | {rule.words} |"


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("error-codes", ErrorCodes)
    app.add_directive("validity-rules", ValidityRules)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
