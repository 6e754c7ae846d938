"""What pages say about the operator, masks, confirmation and deleted runs."""

from django import template
from django.conf import settings

from crowd.dashboard import confirmation
from crowd.results.reading.sessions import single_deletions as count_single_deletions

register = template.Library()


@register.simple_tag
def rare_below() -> int:
    """How many installations a model needs before it is named; 1 or less: every model is."""
    return int(settings.FRONTRUNNER_RARE_BELOW)


@register.simple_tag
def requirement() -> str:
    """What confirms a figure on this server."""
    return confirmation.requirement()


@register.simple_tag
def private_notice() -> str:
    """What a private server says about its figures; "" on others."""
    return confirmation.private_notice()


@register.simple_tag
def operator() -> dict[str, str]:
    """Who runs the server, and the contact with its address; each may be empty."""
    contact = settings.FRONTRUNNER_CONTACT
    address = f"mailto:{contact}" if "@" in contact and "://" not in contact else contact
    return {"name": settings.FRONTRUNNER_OPERATOR, "contact": contact, "address": address}


@register.simple_tag
def single_deletions() -> int:
    """How many runs participants deleted one by one."""
    return count_single_deletions()
