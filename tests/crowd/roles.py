"""People on the staff, by their roles."""

from django.contrib.auth.models import Group, User
from django.test import Client


def browser_of(role: str, name: str = "") -> Client:
    """A browser in which somebody on the staff with that role is logged in (none where it is empty)."""
    user = User.objects.create_user(name or f"{role or 'visitor'}-1", is_staff=True)
    if role:
        user.groups.add(Group.objects.get(name=role))
    browser = Client()
    browser.force_login(user)
    return browser
