"""What waits for the person who is logged in to the administration."""

from typing import Any

from django import template
from django.utils import timezone

from crowd.dashboard import waiting as queues

register = template.Library()


@register.simple_tag(takes_context=True)
def waiting(context: dict[str, Any]) -> tuple[queues.Queue, ...]:
    """The queues of the account's own lists."""
    return queues.waiting(context["request"].user.has_perm, timezone.now())
