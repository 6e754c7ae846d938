"""What every page is made of: the navigation, and the place of a chart with its caption."""

from dataclasses import dataclass
from typing import Any

from django import template
from django.urls import reverse
from django.utils.html import format_html
from django.utils.safestring import SafeString

register = template.Library()


@dataclass(frozen=True)
class Item:
    """One link of the navigation; `current` on the page itself and on all below it."""

    name: str
    address: str
    current: bool


@register.simple_tag(takes_context=True)
def navigation(context: dict[str, Any]) -> tuple[Item, ...]:
    """The main pages in the order in which a visitor asks for them."""
    path = request.path if (request := context.get("request")) else ""
    names = {
        "Devices": "devices",
        "Fronts": "fronts",
        "Explorations": "explorations",
        "Data": "data",
        "About": "about",
    }
    addresses = {name: reverse(f"dashboard:{view}") for name, view in names.items()}
    return tuple(Item(name, address, path.startswith(address)) for name, address in addresses.items())


@register.simple_tag(takes_context=True)
def server(context: dict[str, Any]) -> str:
    """This server's address as a client needs it, without a slash at the end."""
    return context["request"].build_absolute_uri("/").rstrip("/")


@register.simple_block_tag
def chart(content: str, address: str, label: str, height: int = 400) -> SafeString:
    """The place of a figure: ADDRESS gives its JSON, LABEL says what it shows, CONTENT is its caption.

    HEIGHT (pixels) keeps the place free, so that nothing moves when the figure arrives.
    """
    return format_html(
        '<figure class="chart" data-figure="{}">'
        '<div class="plot" role="img" aria-label="{}" style="--height: {}px">'
        '<p class="waiting">Drawing</p></div>'
        "<figcaption>{}</figcaption></figure>",
        address,
        label,
        height,
        content,
    )


@register.filter
def with_query(address: str, query: str) -> str:
    """ADDRESS under the same filters as the page."""
    return f"{address}?{query}" if query else address
