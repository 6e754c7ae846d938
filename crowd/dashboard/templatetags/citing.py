"""The citation at the end of a page, as text and BibTeX."""

import html
from typing import Any
from urllib.parse import quote, urlencode

from django import template
from django.template.loader import render_to_string
from django.utils import timezone
from django.utils.safestring import SafeString

from crowd.dashboard.content.citation import RELEASED, Citation, Version, newest_version
from crowd.dashboard.drawings.drawing import with_query

register = template.Library()


@register.simple_block_tag(takes_context=True)
def cited(
    context: dict[str, Any],
    content: str,
    query: str | None = None,
    digest: str = "",
    page: str = "",
    version: Version | None = None,
    origin: str = RELEASED,
) -> SafeString:
    """The citation of this page with the title `content`.

    `query` is the query string to cite, by default that of the request. `digest` is the digest of the front
    on the page. `page` is the path to cite, by default that of the request. `version`: the release, by
    default the newest. `origin`: where the data of the page are.
    """
    request = context["request"]
    if query is None:
        query = urlencode([(name, value) for name, value in request.GET.items() if value])
    citation = Citation(
        title=" ".join(html.unescape(content).split()),
        url=request.build_absolute_uri(with_query(page or request.path, query)),
        day=timezone.now().date(),
        version=(version or newest_version()) if origin == RELEASED else None,
        front=digest,
        origin=origin,
    )
    # A data URL, because the page already has the content of the file.
    file = f"data:application/x-bibtex;charset=utf-8,{quote(citation.bibtex)}"
    return render_to_string("dashboard/cite.html", {"citation": citation, "file": file})
