"""CITATION.cff has what its format (version 1.2.0) requires, and agrees with the package."""

import tomllib

import yaml

from groundwork import __version__
from tests.docs.pages import ROOT

MEMBERS = {"title", "authors", "type"}


def test_the_citation_is_valid_and_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

    assert citation["cff-version"] == "1.2.0"
    assert {"message", *MEMBERS} <= citation.keys()
    assert citation["type"] in ("software", "dataset")
    assert (citation["version"], citation["license"]) == (__version__, project["license"])
    assert citation["title"].endswith(project["description"])
    for work in (citation, *citation["references"]):
        assert work.keys() >= MEMBERS
        for author in work["authors"]:
            assert "name" in author or {"family-names", "given-names"} <= author.keys()
