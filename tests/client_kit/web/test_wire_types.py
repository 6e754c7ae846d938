"""The types and constants of the browser's client are those of the package `wire`."""

import pytest

from docs.tools.wire_types import FILES, WEB


@pytest.mark.parametrize("name", FILES)
def test_a_written_file_is_fresh(name: str) -> None:
    assert (WEB / name).read_text(encoding="utf-8") == FILES[name](), "run: python -m docs.tools.wire_types"
