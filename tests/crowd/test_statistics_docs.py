"""docs/results/statistics.md says what the registry of rules says."""

import re
from pathlib import Path

from crowd.results.validity.rules import RULES, Rule

DOCS = Path(__file__).parents[2] / "docs" / "results" / "statistics.md"


def row(rule: Rule) -> tuple[str, ...]:
    threshold = "" if rule.threshold is None else f"{rule.threshold:g}"
    return (f"`{rule.code}`", str(rule.state), str(rule.level), threshold, rule.words)


def test_the_table_of_rules_is_the_registry() -> None:
    line = r"^\| (`\w+`) \| (.*?) \| (.*?) \| ?(.*?) \| (.*?) \|$"
    table = re.findall(line, DOCS.read_text(), re.MULTILINE)

    assert table == [row(rule) for rule in RULES.values()]
