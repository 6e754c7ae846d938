"""Tag for the review queues in the administration."""

from typing import Any

from django import template
from django.utils import timezone

from crowd.dashboard.content import review_queues

register = template.Library()


@register.simple_tag(takes_context=True)
def waiting(context: dict[str, Any]) -> tuple[review_queues.Queue, ...]:
    """The review queues that the user may see."""
    return review_queues.waiting(context["request"].user.has_perm, timezone.now())
