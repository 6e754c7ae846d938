"""JSON as HTML tables, for the administration's read-only pages.

| value | shown as |
|---|---|
| object | two columns; nested objects and lists to DEEPEST levels |
| list of objects, object of objects | a row for each, a column for each member; nested objects unfold |
| list of single values | the values, separated by commas; sentences on a line each |
| text longer than LONGEST_TEXT | its beginning; the rest unfolds |
| more than MOST_ROWS rows | the first rows; the rest unfolds |

The raw JSON unfolds below each value. All text is escaped.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString, mark_safe

LONGEST_TEXT = 120
MOST_ROWS = 25
MOST_COLUMNS = 24
DEEPEST = 4
NOTHING = "\N{EM DASH}"


def as_html(value: Any) -> SafeString:
    """`value`, as json.loads returns it, as HTML: a table, with the raw JSON below."""
    if not isinstance(value, dict | list) or not value:
        return _cell(value, 0)
    raw = json.dumps(value, indent=2, ensure_ascii=False)
    return format_html(
        '<div class="json">{}<details class="raw"><summary>Raw JSON</summary><pre>{}</pre></details></div>',
        _cell(value, 0),
        raw,
    )


def _cell(value: Any, depth: int) -> SafeString:
    if isinstance(value, dict | list) and value and depth >= DEEPEST:
        return _long(json.dumps(value, ensure_ascii=False))
    if isinstance(value, dict) and value:
        members = list(value.values())
        if len(members) > 1 and _are_rows(members):
            return _table(list(value.items()), members, depth, keyed=True)
        return _members(value, depth)
    if isinstance(value, list) and value:
        if _are_rows(value):
            return _table([("", row) for row in value], value, depth, keyed=False)
        if any(isinstance(item, dict | list) for item in value):
            return _members({str(index): item for index, item in enumerate(value)}, depth)
        if any(isinstance(item, str) and " " in item for item in value):
            return format_html_join(mark_safe("<br>"), "{}", ((_long(_text(item)),) for item in value))
        return _long(", ".join(_text(item) for item in value))
    return _long(_text(value))


def _are_rows(values: Sequence[Any]) -> bool:
    """Whether `values` are objects with few enough members to be the columns of a table."""
    if not all(isinstance(value, dict) and value for value in values):
        return False
    return len(_columns(values)) <= MOST_COLUMNS


def _columns(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row))


def _table(
    items: Sequence[tuple[str, Mapping[str, Any]]],
    rows: Sequence[Mapping[str, Any]],
    depth: int,
    keyed: bool,
) -> SafeString:
    columns = _columns(rows)
    head = format_html_join("", '<th scope="col">{}</th>', ((name,) for name in columns))
    if keyed:
        head = format_html("<td></td>{}", head)
    body = [
        format_html(
            "<tr>{}{}</tr>",
            format_html('<th scope="row">{}</th>', key) if keyed else "",
            format_html_join(
                "",
                "<td>{}</td>",
                ((_folded(row[name], depth + 1) if name in row else NOTHING,) for name in columns),
            ),
        )
        for key, row in items
    ]
    return _first_rows(head, body, "rows")


def _folded(value: Any, depth: int) -> SafeString:
    """A cell of a row. An object or a list of objects is folded, so that rows stay low."""
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if not inside or (isinstance(value, list) and not any(isinstance(item, dict | list) for item in inside)):
        return _cell(value, depth)
    return format_html("<details><summary>{} members</summary>{}</details>", len(value), _cell(value, depth))


def _members(value: Mapping[str, Any], depth: int) -> SafeString:
    body = [
        format_html('<tr><th scope="row">{}</th><td>{}</td></tr>', name, _cell(member, depth + 1))
        for name, member in value.items()
    ]
    return _first_rows("", body, "members")


def _first_rows(head: str, body: Sequence[SafeString], what: str) -> SafeString:
    """The first MOST_ROWS rows of a table; the others are folded. `what` is their name."""
    first = _rows(head, body[:MOST_ROWS])
    if len(body) <= MOST_ROWS:
        return first
    return format_html(
        "{}<details><summary>{} further {}</summary>{}</details>",
        first,
        len(body) - MOST_ROWS,
        what,
        _rows(head, body[MOST_ROWS:]),
    )


def _rows(head: str, body: Iterable[SafeString]) -> SafeString:
    return format_html(
        "<table>{}<tbody>{}</tbody></table>",
        format_html("<thead><tr>{}</tr></thead>", head) if head else "",
        format_html_join("", "{}", ((row,) for row in body)),
    )


def _long(text: str) -> SafeString:
    if len(text) <= LONGEST_TEXT:
        return format_html("{}", text)
    return format_html(
        '<details class="long"><summary>{}… ({} characters)</summary>{}</details>',
        text[:LONGEST_TEXT].rstrip(),
        len(text),
        text,
    )


def _text(value: Any) -> str:
    if value is None or value == "" or value == [] or value == {}:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)
