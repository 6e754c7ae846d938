"""JSON as tables on the administration's pages."""

import json
from html import unescape
from html.parser import HTMLParser
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.administration import json_tables
from crowd.administration.json_tables import MOST_ROWS, as_html

SCALARS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=150)
JSON = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=5), inner, max_size=5),
    max_leaves=30,
)
# What a browser closes by itself.
VOID = {"br"}
ELEMENTS = VOID | {"div", "table", "thead", "tbody", "tr", "th", "td", "details", "summary", "pre"}


class Balanced(HTMLParser):
    """Reads HTML; `open` is empty at the end where each element was closed in its turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: set[str] = set()

    def handle_starttag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002
        self.names.add(tag)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def raw(html: str) -> Any:
    return json.loads(unescape(html.rsplit("<pre>", 1)[1].split("</pre>")[0]))


def test_an_object_is_two_columns() -> None:
    html = as_html({"ate_max": 0.05, "runtime": 0.2})

    assert '<tr><th scope="row">ate_max</th><td>0.05</td></tr>' in html
    assert "<thead>" not in html


def test_a_list_of_objects_is_a_table_with_a_column_for_each_member() -> None:
    html = as_html([{"name": "mu", "values": [0.1, 0.2]}, {"name": "loops", "default": False}])

    assert '<tr><th scope="col">name</th><th scope="col">values</th><th scope="col">default</th></tr>' in html
    assert "<tr><td>mu</td><td>0.1, 0.2</td><td>\N{EM DASH}</td></tr>" in html
    assert "<tr><td>loops</td><td>\N{EM DASH}</td><td>no</td></tr>" in html


def test_an_object_of_like_objects_is_a_table_with_a_row_for_each() -> None:
    html = as_html({"default": {"mu": 0.1}, "best": {"mu": 0.4}})

    assert '<th scope="col">mu</th>' in html
    assert '<tr><th scope="row">best</th><td>0.4</td></tr>' in html


@pytest.mark.parametrize("value", [None, {}, []])
def test_nothing_is_a_dash(value: Any) -> None:
    assert as_html(value) == "\N{EM DASH}"


def test_what_somebody_sent_is_text_and_never_html() -> None:
    html = as_html({"<b>name</b>": ["<script>", {"deep": "<img src=x>"}], "x": "'\"&"})

    for harmful in ("<script", "<b>", "<img"):
        assert harmful not in html
    assert "&lt;script&gt;" in html


def test_a_long_text_is_cut_and_can_be_seen_whole() -> None:
    html = as_html({"command": "word " * 100})

    assert "(500 characters)</summary>" in html
    assert "word " * 100 in html.split("</summary>")[1]


def test_rows_beyond_the_first_can_be_unfolded() -> None:
    html = as_html([{"t": second} for second in range(MOST_ROWS + 7)])

    first, rest = html.split("<summary>7 further rows</summary>")
    assert first.count("<td>") == MOST_ROWS
    assert f"<td>{MOST_ROWS + 6}</td>" in rest


def test_what_is_inside_of_a_row_is_unfolded_on_demand() -> None:
    html = as_html([{"name": "mu", "predicted": {"runtime": 0.5, "ate_max": 0.25}}])

    assert "<td>mu</td><td><details><summary>2 members</summary><table>" in html


def test_sentences_have_a_line_each() -> None:
    assert "<td>a * b &lt;= 4<br>a, c &gt; 1</td>" in as_html({"constraints": ["a * b <= 4", "a, c > 1"]})


@given(JSON)
def test_whatever_json_it_is_the_page_is_whole_and_has_it_raw(value: Any) -> None:
    html = as_html(value)

    reader = Balanced()
    reader.feed(html)
    assert reader.open == []
    assert reader.names <= ELEMENTS
    if isinstance(value, dict | list) and value:
        assert raw(html) == value


def test_what_lies_deep_is_not_lost() -> None:
    value: Any = "at the bottom"
    for _ in range(json_tables.DEEPEST + 5):
        value = {"in": value}

    assert "at the bottom" in as_html(value).split('<details class="raw">')[0]
