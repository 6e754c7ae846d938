"""Views of drawings: the figure (for a page, or to save as a file), CSV, JSON, and a page to embed.

All have ETags.
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

from crowd.dashboard.comparing.comparison import InvalidComparisonError
from crowd.dashboard.content import citation
from crowd.dashboard.content.confirmation import private_notice
from crowd.dashboard.drawings.drawing import Cell, Drawing, with_query
from crowd.dashboard.drawings.latex import latex
from crowd.dashboard.figures.palette import LIGHT, THEMES
from crowd.dashboard.figures.saving import MEDIA, Medium, render_for
from crowd.dashboard.responses import cached, conditional_response, page
from crowd.demo.mark import file_name
from crowd.explorations.outcomes.exports import FORMULA_START
from crowd.results.opendata.tables import LICENCE
from crowd.results.reading.queries.filters import InvalidFilterError
from crowd.results.reading.selectors import UnknownFrontError

HTML = "text/html; charset=utf-8"
JSON = "application/json"
KINDS = {"csv": "text/csv; charset=utf-8", "json": JSON, "tex": "application/x-tex; charset=utf-8"}
# Query parameter of figures on embedded pages.
EMBEDDED = "embedded"
# Query parameter with the medium that a figure is saved for.
SAVE = "save"

View = Callable[..., HttpResponseBase]
Show = Callable[[HttpRequest, Drawing[Any], Any, dict[str, Any]], str]


def url_patterns(drawing: Drawing[Any]) -> Iterator[URLPattern]:
    """The URL patterns of `drawing`; their names are its name plus -figure, -csv, -json, -tex, -embed."""
    name, below = drawing.name, drawing.path
    yield path(f"figures/{below}.json", page(explain_errors(_figure_view(drawing))), name=f"{name}-figure")
    for kind, show in (("csv", render_csv), ("json", render_json), ("tex", render_latex)):
        table = _export_view(drawing, show, KINDS[kind], kind)
        yield path(f"tables/{below}.{kind}", page(explain_errors(table)), name=f"{name}-{kind}")
    embed = _export_view(drawing, render_embed, HTML)
    # Only these pages may be framed by other sites: they set no cookies and change nothing.
    framed = xframe_options_exempt(csp_replace({"frame-ancestors": ["*"]})(page(explain_errors(embed))))
    yield path(f"embed/{below}/", framed, name=f"{name}-embed")


def render_csv(_: HttpRequest, drawing: Drawing[Any], rows: Any, __: dict[str, Any]) -> str:
    """The table as CSV with a header line. Missing values are empty."""
    table = drawing.table(rows)
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(table.columns)
    writer.writerows([_cell(cell) for cell in row] for row in table.rows)
    return text.getvalue()


def render_json(request: HttpRequest, drawing: Drawing[Any], rows: Any, arguments: dict[str, Any]) -> str:
    """The table as JSON, with everything needed to cite it."""
    table = drawing.table(rows)
    about = {
        "title": drawing.title(rows),
        "n": unicodedata.normalize("NFKC", drawing.n(rows)),
        "simulated": drawing.simulated,
        "definition": drawing.definition_of_table,
        "page": request.build_absolute_uri(page_address(request, drawing, arguments)),
        "filters": _query(request).dict(),
        "licence": LICENCE,
        "columns": table.columns,
        "rows": [
            {name: _finite(cell) for name, cell in zip(table.columns, row, strict=True)} for row in table.rows
        ],
    }
    return json.dumps(about)


def render_latex(request: HttpRequest, drawing: Drawing[Any], rows: Any, arguments: dict[str, Any]) -> str:
    """The table as LaTeX, with what it shows and its source as comments."""
    caption = f"{drawing.title(rows)}. n = {unicodedata.normalize('NFKC', drawing.n(rows))}"
    if drawing.simulated:
        caption += f". {citation.SIMULATED}"
    notes = [caption, drawing.definition_of_table, *_source(request, drawing, arguments)]
    return latex(drawing.paper_table(rows), caption, notes)


def render_embed(request: HttpRequest, drawing: Drawing[Any], rows: Any, arguments: dict[str, Any]) -> str:
    """A page with only the figure and its description, for other sites."""
    rows = drawing.embedded(rows)
    heading, topic = drawing.heading(rows)
    figure = reverse(f"dashboard:{drawing.name}-figure", kwargs=arguments)
    table = reverse(f"dashboard:{drawing.name}-csv", kwargs=arguments)
    query = _query(request)
    query[EMBEDDED] = "1"
    return render_to_string(
        "dashboard/embed.html",
        {
            "drawing": drawing,
            "definition": drawing.definition,
            "heading": heading,
            "topic": topic,
            "n": drawing.n(rows),
            "page": page_address(request, drawing, arguments),
            "figure": with_query(figure, query.urlencode()),
            "table": with_query(table, _query(request).urlencode()),
            "picture": drawing.picture(rows) if drawing.picture else None,
            "private": private_notice(),
            "licence": LICENCE,
            "demo": drawing.simulated,
        },
        request,
    )


def page_address(request: HttpRequest, drawing: Drawing[Any], arguments: dict[str, Any]) -> str:
    """The page that shows `drawing` under the filters of `request`."""
    return with_query(drawing.page(**arguments), _query(request).urlencode())


def explain_errors(view: View) -> View:
    """`view`, with errors about invalid queries answered as plain text."""

    @wraps(view)
    def answer(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        try:
            return view(request, **arguments)
        except UnknownFrontError as error:
            return _error_response(error, 404)
        except (InvalidFilterError, InvalidComparisonError) as error:
            return _error_response(error, 400)

    return answer


def _error_response(error: Exception, status: int) -> HttpResponse:
    return HttpResponse(str(error), status=status, content_type="text/plain; charset=utf-8")


def _source(request: HttpRequest, drawing: Drawing[Any], arguments: dict[str, Any]) -> tuple[str, ...]:
    """The parts of the source line of `drawing`: address, date, release, licence."""
    address = request.build_absolute_uri(page_address(request, drawing, arguments))
    day, release = timezone.now().date(), citation.newest_version()
    return citation.source(address, day, release, private_notice(), drawing.origin)


def _export_view(drawing: Drawing[Any], show: Show, kind: str, suffix: str = "") -> View:
    def view(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        rows = drawing.read(request, **arguments)
        response = conditional_response(request, show(request, drawing, rows, arguments).encode(), kind)
        if suffix:
            name = f"{_file_name(drawing)}.{suffix}"
            response["Content-Disposition"] = f'attachment; filename="{name}"'
        return response

    return view


def _figure_view(drawing: Drawing[Any]) -> View:
    """The view of the figure in the theme ?theme=, or for the medium ?save=.

    A figure with a stamp is cached.
    """

    def view(request: HttpRequest, **arguments: Any) -> HttpResponseBase:
        medium = MEDIA.get(request.GET.get(SAVE, ""))
        if medium:
            return conditional_response(request, _saved(request, drawing, medium, arguments), JSON)
        theme = THEMES.get(request.GET.get("theme", ""), LIGHT)
        embedded = bool(request.GET.get(EMBEDDED))

        def draw() -> bytes:
            rows = drawing.read(request, **arguments)
            figure = drawing.draw(drawing.embedded(rows) if embedded else rows, theme)
            return bytes(figure.to_json(validate=False).encode())

        if drawing.stamp is None:
            return conditional_response(request, draw(), JSON)
        facts = (request.path, theme.name, embedded, drawing.stamp(request, **arguments))
        return conditional_response(request, cached(facts, draw), JSON)

    return view


def _saved(request: HttpRequest, drawing: Drawing[Any], medium: Medium, arguments: dict[str, Any]) -> bytes:
    """The figure for `medium` as JSON, with the text around it."""
    rows = drawing.read(request, **arguments)
    title, topic = drawing.heading(rows)
    n = f"n\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}{drawing.n(rows)}"
    note = ". ".join(filter(None, [topic, n]))
    source = _source(request, drawing, arguments)
    picture = render_for(drawing.draw(rows, LIGHT), medium, title, note, source)
    about = {
        "name": f"{_file_name(drawing)}-{medium.name}",
        "title": title,
        "description": " ".join([f"{note}.", drawing.definition, *source]),
    }
    document = picture.figure.to_dict() | {"saved": picture.frame() | about}
    # Fonts used in papers lack the narrow no-break space.
    text: str = to_json_plotly(document)
    for narrow, usual in ((r"\u202f", r"\u00a0"), ("\N{NARROW NO-BREAK SPACE}", "\N{NO-BREAK SPACE}")):
        text = text.replace(narrow, usual)
    return text.encode()


def _file_name(drawing: Drawing[Any]) -> str:
    name = f"frontrunner-{drawing.name}"
    return file_name(name) if drawing.simulated else name


def _query(request: HttpRequest) -> QueryDict:
    """The query of `request` without parameters of the drawing itself."""
    query = request.GET.copy()
    query.pop("theme", None)
    query.pop(EMBEDDED, None)
    query.pop(SAVE, None)
    return query


def _cell(cell: Cell) -> Cell:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA_START) else _finite(cell)


def _finite(cell: Cell) -> Cell:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell
