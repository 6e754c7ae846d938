"""Tags of all pages: navigation, title, and charts with captions."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any
from urllib.parse import urlencode

import segno
from django import template
from django.conf import settings
from django.http import HttpRequest
from django.template.loader import render_to_string
from django.urls import reverse
from django.utils.html import escape, format_html
from django.utils.safestring import SafeString, mark_safe
from django.utils.translation import gettext

from crowd.dashboard.content.parameter_bars import Bar
from crowd.dashboard.content.points import SequenceColumn
from crowd.dashboard.drawings.drawing import with_query
from crowd.dashboard.figures.bar_picture import BarPicture

register = template.Library()

# Pixels for the title and caption of an embedded figure.
CAPTION = 220
VIEWS = {
    "Measure": "measure",
    "Devices": "devices",
    "Compare": "compare",
    "What to use": "recommend",
    "Fronts": "fronts",
    "Transfer": "transfer",
    "Explorations": "explorations",
    "Data": "data",
    "About": "about",
}
FILTERED = frozenset({"Devices", "Compare", "What to use", "Transfer"})


@dataclass(frozen=True)
class Item:
    """A link of the navigation. `current`: the page is at or below its address."""

    name: str
    address: str
    current: bool


@register.filter
def named_sequences(columns: Iterable[SequenceColumn], held_out: bool) -> str:
    """The names of the sequences in `columns` that are `held_out` or not: a, b and c."""
    names = [column.name for column in columns if column.held_out == held_out]
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


@register.filter
def linked_exports(text: str) -> SafeString:
    """`text` with the addresses of exports as links."""
    return mark_safe(re.sub(r"/data/[\w-]+/", r'<a href="\g<0>">\g<0></a>', escape(text)))


@register.simple_tag(takes_context=True)
def navigation(context: dict[str, Any]) -> tuple[Item, ...]:
    """The links to the main pages, with the current application."""
    request = context.get("request")
    path, crowd = request.path if request else "", _crowd(context)
    return tuple(
        Item(gettext(name), with_query(address, crowd if name in FILTERED else ""), path.startswith(address))
        for name, address in _addresses().items()
    )


@cache
def _addresses() -> dict[str, str]:
    return {name: reverse(f"dashboard:{view}") for name, view in VIEWS.items()}


@register.simple_tag(takes_context=True)
def home_of_crowd(context: dict[str, Any]) -> str:
    """The address of the home page for the application that the visitor looks at."""
    return with_query(reverse("dashboard:home"), _crowd(context))


def _crowd(context: dict[str, Any]) -> str:
    """The query with the application that was asked for."""
    request = context.get("request")
    application = request.GET.get("application") if request else None
    return urlencode({"application": application}) if application else ""


@register.simple_block_tag
def titled(content: str) -> SafeString:
    """`content` as the title of the page, for browsers and link previews."""
    return format_html('<title>{0}</title>\n  <meta property="og:title" content="{0}">', content)


@register.simple_block_tag
def described(content: str) -> SafeString:
    """`content` as the description of the page, for search engines and link previews."""
    return format_html(
        '<meta name="description" content="{0}">\n  <meta property="og:description" content="{0}">', content
    )


@register.simple_tag(takes_context=True)
def server(context: dict[str, Any]) -> str:
    """The address of this server for clients, without a slash at its end."""
    request: HttpRequest = context["request"]
    return request.build_absolute_uri("/").rstrip("/")


@register.simple_tag
def source() -> str:
    """The address of the source and documentation of this server; may be empty."""
    address: str = settings.FRONTRUNNER_SOURCE
    return address


@register.simple_tag
def qr_code(address: str) -> SafeString:
    """`address` as a QR code."""
    svg: str = segno.make(address, micro=False).svg_inline(scale=4, border=2, dark="#131b20", light="#ffffff")
    return mark_safe(svg)


@register.filter
def level(bar: Bar) -> SafeString:
    """The shapes of `bar`: as wide as it is, and the line of the default's value."""
    line = f'<line x1="{bar.mark}%" x2="{bar.mark}%" y2="100%"/>' if bar.mark else ""
    return mark_safe(f'<rect width="{bar.width}%" height="100%"/>{line}')


@register.simple_block_tag(takes_context=True)
def chart(
    context: dict[str, Any],
    content: str,
    name: str,
    label: str,
    height: int = 400,
    query: str = "",
    folded: str = "",
    picture: BarPicture | None = None,
    **arguments: Any,
) -> SafeString:
    """The drawing `name` with `label` for screen readers and `content` as its caption.

    `arguments` are those of the drawing's path, `query` has the filters. `height` (pixels) reserves the
    space. On a phone, a `folded` chart is closed, with that word as its summary. A `picture` needs no script.
    """
    addresses = {
        kind: with_query(reverse(f"dashboard:{name}-{kind}", kwargs=arguments), query)
        for kind in ("figure", "csv", "json", "tex", "embed")
    }
    return render_to_string(
        "dashboard/chart.html",
        {
            "name": name,
            "label": label,
            # After the semicolon, a label says where the numbers are on this page.
            "shown": label.partition(";")[0],
            "height": height,
            "framed": height + CAPTION,
            "addresses": addresses,
            "embed": context["request"].build_absolute_uri(addresses["embed"]),
            "caption": content,
            "folded": folded,
            "picture": picture,
        },
    )
