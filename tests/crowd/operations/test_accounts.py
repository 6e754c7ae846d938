"""Accounts of the staff: one name a person, and a log of what was changed about whom, by whom."""

from typing import Any

import pytest
from django.contrib.auth.models import Group, User
from django.core.exceptions import ValidationError
from django.core.management import call_command
from django.core.management.base import CommandError
from django.test import Client

from crowd.access.roles import EDITOR
from crowd.audit import accounts
from crowd.audit.models import AuditEntry
from crowd.audit.services import record

PASSWORD = "a long enough pass phrase"


@pytest.fixture
def browser(db: None) -> Client:
    """The administration, used by the superuser `root`."""
    browser = Client()
    browser.force_login(User.objects.create_superuser("root", "", PASSWORD))
    return browser


def change(browser: Client, account: User, **changes: Any) -> Any:
    """Send the administration's form of `account` with `changes`."""
    address = f"/admin/auth/user/{account.pk}/change/"
    form = browser.get(address).context["adminform"].form
    values = {name: form.get_initial_for_field(field, name) for name, field in form.fields.items()}
    moments = {"date_joined_0": "2026-01-01", "date_joined_1": "00:00:00"}
    lists = {name: [each.pk for each in values.pop(name)] for name in ("groups", "user_permissions")}
    sent = {name: value for name, value in values.items() if value not in (None, False)}
    sent |= lists | moments | changes
    return browser.post(address, {name: value for name, value in sent.items() if value is not None})


def logged(subject: str) -> list[tuple[str, str]]:
    """Who did what to `subject`, in order."""
    entries = AuditEntry.objects.filter(subject=subject).order_by("pk")
    return list(entries.values_list("actor", "action"))


@pytest.mark.parametrize(("first", "second"), [("ann", "Ann"), ("ägidius", "ÄGIDIUS")])
def test_a_name_in_another_case_is_refused_where_accounts_are_made(
    browser: Client, first: str, second: str
) -> None:
    User.objects.create_user(first)

    answer = browser.post(
        "/admin/auth/user/add/",
        {"username": second, "password1": PASSWORD, "password2": PASSWORD, "usable_password": "true"},
    )
    assert answer.status_code == 200
    assert "already" in str(answer.context["adminform"].form.errors["username"])
    with pytest.raises(ValidationError, match=f"there is an account '{first}' already"):
        User.objects.create_user(second)
    with pytest.raises(CommandError, match="case makes no difference"):
        call_command("createsuperuser", username=second, email="", interactive=False)
    assert not User.objects.filter(username=second).exists()


@pytest.mark.slow
def test_a_name_in_another_case_is_refused_where_accounts_are_renamed(browser: Client) -> None:
    User.objects.create_user("ann")
    bob = User.objects.create_user("bob")

    answer = change(browser, bob, username="ANN")
    assert "case makes no difference" in str(answer.context["adminform"].form.errors["username"])
    assert change(browser, bob, username="Bob").status_code == 302
    assert User.objects.filter(username="Bob").exists()


def test_equal_names_of_an_earlier_release_are_named(db: None) -> None:
    User.objects.bulk_create([User(username="ann"), User(username="bob"), User(username="Ann")])

    (line,) = accounts.equal_names()
    assert line.startswith("The accounts ann and Ann differ only in case: rename or delete")


def test_changes_of_accounts_are_logged_with_who_made_them(browser: Client) -> None:
    ann = User.objects.create_user("ann")
    editor = Group.objects.get(name=EDITOR)

    change(browser, ann, is_staff="on", is_superuser="on", groups=[editor.pk])
    change(browser, ann, username="anna", is_superuser=None, groups=[], is_staff="on")
    browser.post(
        f"/admin/auth/user/{ann.pk}/password/",
        {"password1": PASSWORD, "password2": PASSWORD, "usable_password": "true", "set-password": "1"},
    )
    browser.post(f"/admin/auth/user/{ann.pk}/delete/", {"post": "yes"})

    assert logged("account ann") == [
        ("command line", "created"),
        ("root", "is_staff set"),
        ("root", "is_superuser set"),
        ("root", "group added"),
    ]
    assert logged("account anna") == [
        ("root", "renamed"),
        ("root", "is_superuser taken away"),
        ("root", "group removed"),
        ("root", "password changed"),
        ("root", "deleted"),
    ]
    renamed = AuditEntry.objects.get(action="renamed")
    assert renamed.note == f"id {ann.pk}; before: ann"
    assert renamed.account == User.objects.get(username="root").pk


def test_changes_of_roles_are_logged_from_either_side(db: None) -> None:
    role, ann = Group.objects.create(name="reviewer"), User.objects.create_user("ann")
    role.user_set.add(ann)
    role.user_set.clear()
    role.permissions.add(*Group.objects.get(name=EDITOR).permissions.all()[:1])
    role.name = "reader"
    role.save()
    role.delete()

    assert [action for _, action in logged("account ann")] == ["created", "group added", "group removed"]
    assert [action for _, action in logged("role reviewer")] == ["created", "permission added"]
    assert [action for _, action in logged("role reader")] == ["renamed", "deleted"]


def test_a_log_in_is_no_change_of_the_account(db: None, settings: Any) -> None:
    User.objects.create_superuser("ann", "", PASSWORD)
    before = AuditEntry.objects.count()
    newer = "django.contrib.auth.hashers.PBKDF2PasswordHasher"
    settings.PASSWORD_HASHERS = [newer, *settings.PASSWORD_HASHERS]
    stored = User.objects.get().password

    Client().post("/admin/login/?next=/admin/", {"username": "ann", "password": PASSWORD})

    assert User.objects.get().last_login is not None
    assert User.objects.get().password != stored
    assert AuditEntry.objects.count() == before


def test_the_log_keeps_the_id_of_a_deleted_account(db: None) -> None:
    ann = User.objects.create_user("ann")
    entry, key = record("ann", "tried", "front kfusion-1"), ann.pk
    ann.delete()

    entry.refresh_from_db()
    assert (entry.actor, entry.account) == ("ann", key)
    assert record("command line", "tried", "front kfusion-1").account is None
