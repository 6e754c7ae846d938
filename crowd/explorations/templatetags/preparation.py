"""How far the preparation of a front is, with its buttons, on the front's page in the administration."""

from typing import Any

from django import template
from django.template.context import RequestContext

from crowd.explorations import selectors
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.steps import SUBMIT

register = template.Library()


@register.inclusion_tag("admin/explorations/preparation.html", takes_context=True)
def preparation(context: RequestContext, front: FrontVersion) -> dict[str, Any]:
    """The newest preparation of `front`."""
    return {
        "front": front,
        "seen": selectors.preparation_progress(front),
        "may": context["request"].user.has_perm(SUBMIT),
        "csrf_token": context["csrf_token"],
    }
