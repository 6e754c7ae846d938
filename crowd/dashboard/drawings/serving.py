"""Answers a drawing's addresses: the figure (for a page, or to save as a file), its numbers as CSV and JSON,
and a page to embed.

Each has an ETag: what the caller holds already is not sent again.
"""

import csv
import io
import json
import math
import unicodedata
from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any

from csp.decorators import csp_replace
from django.http import HttpRequest, HttpResponse, HttpResponseBase, QueryDict
from django.template.loader import render_to_string
from django.urls import URLPattern, path, reverse
from django.utils import timezone
from django.views.decorators.clickjacking import xframe_options_exempt
from plotly.io.json import to_json_plotly

from crowd.dashboard import citation
from crowd.dashboard.answering import conditional, kept, page
from crowd.dashboard.comparing.comparison import InvalidComparisonError
from crowd.dashboard.confirmation import private_notice
from crowd.dashboard.drawings.drawing import Cell, Drawing, with_query
from crowd.dashboard.figures.saving import MEDIA, Medium, saved
from crowd.dashboard.palette import LIGHT, THEMES
from crowd.explorations.outcomes.exports import FORMULA
from crowd.results.opendata.tables import LICENCE
from crowd.results.reading.queries.filters import InvalidFilterError
from crowd.results.reading.selectors import UnknownFrontError

CSV = "text/csv; charset=utf-8"
HTML = "text/html; charset=utf-8"
JSON = "application/json"
# Which figures an embedded page asks for: those that other sites show.
EMBEDDED = "embedded"
# The medium that a figure is saved for.
SAVE = "save"

View = Callable[..., HttpResponseBase]
Show = Callable[[HttpRequest, Drawing[Any], Any, dict[str, Any]], str]


def addresses(drawing: Drawing[Any]) -> Iterator[URLPattern]:
    """The four addresses of DRAWING; their names are its own and -figure, -csv, -json, -embed."""
    name, below = drawing.name, drawing.path
    yield path(f"figures/{below}.json", page(refusing(_figure(drawing))), name=f"{name}-figure")
    yield path(f"tables/{below}.csv", page(refusing(_shown(drawing, csv_of, CSV))), name=f"{name}-csv")
    yield path(f"tables/{below}.json", page(refusing(_shown(drawing, json_of, JSON))), name=f"{name}-json")
    embed = _shown(drawing, page_of, HTML)
    # The only pages that other sites may frame: they set no cookie and change nothing.
    framed = xframe_options_exempt(csp_replace({"frame-ancestors": ["*"]})(page(refusing(embed))))
    yield path(f"embed/{below}/", framed, name=f"{name}-embed")


def csv_of(_: HttpRequest, drawing: Drawing[Any], rows: Any, __: dict[str, Any]) -> str:
    """The numbers, a line a row, below one line of names. What is absent is empty."""
    table = drawing.table(rows)
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(table.columns)
    writer.writerows([_cell(cell) for cell in row] for row in table.rows)
    return text.getvalue()


def json_of(request: HttpRequest, drawing: Drawing[Any], rows: Any, arguments: dict[str, Any]) -> str:
    """The numbers, with all that is needed to cite them."""
    table = drawing.table(rows)
    about = {
        "title": drawing.title(rows),
        "n": unicodedata.normalize("NFKC", drawing.n(rows)),
        "simulated": drawing.simulated(rows),
        "definition": drawing.definition,
        "page": request.build_absolute_uri(page_address(request, drawing, arguments)),
        "filters": _query(request).dict(),
        "licence": LICENCE,
        "columns": table.columns,
        "rows": [
            {name: _finite(cell) for name, cell in zip(table.columns, row, strict=True)} for row in table.rows
        ],
    }
    return json.dumps(about)


def page_of(request: HttpRequest, drawing: Drawing[Any], rows: Any, arguments: dict[str, Any]) -> str:
    """The figure alone, with what a reader elsewhere must know of it."""
    rows = drawing.embedded(rows)
    heading, topic = drawing.heading(rows)
    figure = reverse(f"dashboard:{drawing.name}-figure", kwargs=arguments)
    query = _query(request)
    query[EMBEDDED] = "1"
    return render_to_string(
        "dashboard/embed.html",
        {
            "simulated": drawing.simulated(rows),
            "definition": drawing.definition,
            "heading": heading,
            "topic": topic,
            "n": drawing.n(rows),
            "page": page_address(request, drawing, arguments),
            "figure": with_query(figure, query.urlencode()),
            "private": private_notice(),
            "licence": LICENCE,
        },
        request,
    )


def page_address(request: HttpRequest, drawing: Drawing[Any], arguments: dict[str, Any]) -> str:
    """The page that shows DRAWING under the filters of REQUEST."""
    return with_query(drawing.page(**arguments), _query(request).urlencode())


def refusing(view: View) -> View:
    """VIEW, with an answer that explains a query that it cannot understand."""

    @wraps(view)
    def answer(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        try:
            return view(request, **arguments)
        except UnknownFrontError as error:
            return _refused(error, 404)
        except (InvalidFilterError, InvalidComparisonError) as error:
            return _refused(error, 400)

    return answer


def _refused(error: Exception, status: int) -> HttpResponse:
    return HttpResponse(str(error), status=status, content_type="text/plain; charset=utf-8")


def _shown(drawing: Drawing[Any], show: Show, kind: str) -> View:
    def view(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        rows = drawing.read(request, **arguments)
        response = conditional(request, show(request, drawing, rows, arguments).encode(), kind)
        if kind != HTML:
            name = f"{_file_name(drawing, rows)}.{'csv' if kind == CSV else 'json'}"
            response["Content-Disposition"] = f'attachment; filename="{name}"'
        return response

    return view


def _figure(drawing: Drawing[Any]) -> View:
    """The figure in the theme that ?theme= names, or for the medium that ?save= names; one with a stamp is
    drawn once for all who ask soon.
    """

    def view(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        medium = MEDIA.get(request.GET.get(SAVE, ""))
        if medium:
            return conditional(request, _saved(request, drawing, medium, arguments), JSON)
        theme = THEMES.get(request.GET.get("theme", ""), LIGHT)
        embedded = bool(request.GET.get(EMBEDDED))

        def draw() -> bytes:
            rows = drawing.read(request, **arguments)
            figure = drawing.draw(drawing.embedded(rows) if embedded else rows, theme)
            return bytes(figure.to_json(validate=False).encode())

        if drawing.stamp is None:
            return conditional(request, draw(), JSON)
        facts = (request.path, theme.name, embedded, drawing.stamp(request, **arguments))
        return conditional(request, kept(facts, draw), JSON)

    return view


def _saved(request: HttpRequest, drawing: Drawing[Any], medium: Medium, arguments: dict[str, Any]) -> bytes:
    """The figure for MEDIUM, with the lines of text around it."""
    rows = drawing.read(request, **arguments)
    title, topic = drawing.heading(rows)
    n = f"n\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}{drawing.n(rows)}"
    note, simulated = ". ".join(filter(None, [topic, n])), drawing.simulated(rows)
    page = request.build_absolute_uri(page_address(request, drawing, arguments))
    today = timezone.now().date()
    source = citation.source(page, today, citation.newest_version(), simulated, private_notice())
    picture = saved(drawing.draw(rows, LIGHT), medium, title, note, source)
    about = {
        "name": f"{_file_name(drawing, rows)}-{medium.name}",
        "title": title,
        "description": " ".join([f"{note}.", drawing.definition, *source]),
    }
    document = picture.figure.to_dict() | {"saved": picture.frame() | about}
    # Fonts of papers lack the narrow space.
    text = to_json_plotly(document)
    for narrow, usual in ((r"\u202f", r"\u00a0"), ("\N{NARROW NO-BREAK SPACE}", "\N{NO-BREAK SPACE}")):
        text = text.replace(narrow, usual)
    return text.encode()


def _file_name(drawing: Drawing[Any], rows: Any) -> str:
    # Nothing inside a CSV says that it is simulated.
    return f"frontrunner-{drawing.name}{'-simulated' if drawing.simulated(rows) else ''}"


def _query(request: HttpRequest) -> QueryDict:
    """What the caller asked for, without what says how a figure is drawn."""
    query = request.GET.copy()
    query.pop("theme", None)
    query.pop(EMBEDDED, None)
    query.pop(SAVE, None)
    return query


def _cell(cell: Cell) -> Cell:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA) else _finite(cell)


def _finite(cell: Cell) -> Cell:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell
