"""The types of the browser's client are those of the structs that travel."""

from docs.tools.wire_types import FILE, declarations


def test_the_written_types_are_those_of_the_structs() -> None:
    assert FILE.read_text(encoding="utf-8") == declarations(), "run: python -m docs.tools.wire_types"
