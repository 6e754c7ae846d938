"""How the page is cited: at its end, as text and as BibTeX."""

import html
from typing import Any
from urllib.parse import quote, urlencode

from django import template
from django.template.loader import render_to_string
from django.utils import timezone
from django.utils.safestring import SafeString

from crowd.dashboard.citation import Citation, newest_version
from crowd.dashboard.drawings.drawing import with_query

register = template.Library()


@register.simple_block_tag(takes_context=True)
def cited(
    context: dict[str, Any],
    content: str,
    simulated: bool = False,
    query: str | None = None,
    digest: str = "",
) -> SafeString:
    """How to cite this page, whose title is CONTENT. QUERY is what it shows: by default, all that was asked
    for. DIGEST is that of the front that the page is about.
    """
    request = context["request"]
    if query is None:
        query = urlencode([(name, value) for name, value in request.GET.items() if value])
    citation = Citation(
        title=" ".join(html.unescape(content).split()),
        url=request.build_absolute_uri(with_query(request.path, query)),
        day=timezone.now().date(),
        version=newest_version(),
        simulated=simulated,
        front=digest,
    )
    # A file without an address of its own: what is in it is on the page.
    file = f"data:application/x-bibtex;charset=utf-8,{quote(citation.bibtex)}"
    return render_to_string("dashboard/cite.html", {"citation": citation, "file": file})
