"""Tags about the operator, masks, confirmation and deleted runs."""

from django import template
from django.conf import settings

from crowd.dashboard.content import confirmation
from crowd.results.reading.sessions import single_deletions as count_single_deletions

register = template.Library()


@register.simple_tag
def rare_below() -> int:
    """The number of installations from which a model is named; with 1 or less, every model is."""
    return int(settings.FRONTRUNNER_RARE_BELOW)


@register.simple_tag
def quorum() -> int:
    """The number of independent networks from which a figure counts."""
    return int(settings.FRONTRUNNER_QUORUM)


@register.simple_tag
def requirement() -> str:
    """The condition for a confirmed figure on this server."""
    return confirmation.requirement()


@register.simple_tag
def private_notice() -> str:
    """The notice of a private server about its figures; "" on others."""
    return confirmation.private_notice()


@register.simple_tag
def operator() -> dict[str, str]:
    """The name of the operator, and the contact with its address; each may be empty."""
    contact = settings.FRONTRUNNER_CONTACT
    address = f"mailto:{contact}" if "@" in contact and "://" not in contact else contact
    return {"name": settings.FRONTRUNNER_OPERATOR, "contact": contact, "address": address}


@register.simple_tag
def single_deletions() -> int:
    """The number of runs that participants deleted one by one."""
    return count_single_deletions()
