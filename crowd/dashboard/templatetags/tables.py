"""Column heads that sort a table."""

from typing import Any

from django import template
from django.utils.html import format_html
from django.utils.safestring import SafeString, mark_safe

register = template.Library()


@register.simple_tag(takes_context=True)
def head(context: dict[str, Any], column: str, label: str, number: bool = False) -> SafeString:
    """The head of `column` with `label`, linked to the table sorted by it.

    A compact table, which is part of a longer one, has no links.
    """
    kind = mark_safe(' class="number"') if number else ""
    if context.get("compact"):
        return format_html('<th scope="col"{}>{}</th>', kind, label)
    asked = context["asked"]
    now = asked.order
    sorted_by = format_html(' aria-sort="{}"', now.aria) if now.column == column else ""
    address = asked.sorted_by(now.after_click(column))
    return format_html('<th scope="col"{}{}><a href="{}#rows">{}</a></th>', kind, sorted_by, address, label)
