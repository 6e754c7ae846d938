"""What pages say of rare models."""

from django import template
from django.conf import settings

register = template.Library()


@register.simple_tag
def rare_below() -> int:
    """How many installations a model needs before it is named; 1 or less: every model is."""
    return int(settings.FRONTRUNNER_RARE_BELOW)
