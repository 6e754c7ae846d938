"""Accounts and roles of the staff: user names are unique without regard to case, changes are logged."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

from django.contrib.auth.models import Group, User
from django.core.exceptions import ValidationError
from django.db.models import Model, signals

from crowd.audit.services import record_by_current

FLAGS = ("is_staff", "is_superuser", "is_active")
RECORDED = frozenset({"username", "name", "password", *FLAGS})
# Django saves this alone when it stores the same password with a newer hash.
REHASH = frozenset({"password"})
MEMBERSHIPS = (User.groups, User.user_permissions, Group.permissions)
ADDED, REMOVED, EMPTIED = "post_add", "post_remove", "pre_clear"


def connect() -> None:
    """Check names and log changes from now on."""
    for model in (User, Group):
        signals.pre_save.connect(_before, sender=model)
        signals.post_save.connect(_after, sender=model)
        signals.post_delete.connect(_deleted, sender=model)
    for field in MEMBERSHIPS:
        signals.m2m_changed.connect(_members_changed, sender=field.through)


def check_name(name: str, account: int | None) -> None:
    """Raise ValidationError if another account than the one with the id `account` has `name`, in any case."""
    others = User.objects.exclude(pk__in=[account] if account else []).values_list("username", flat=True)
    # In Python: SQLite compares only ASCII without regard to case.
    taken = next((other for other in others if other.casefold() == name.casefold()), None)
    if taken is not None:
        raise ValidationError(
            f"user name {name!r}: there is an account {taken!r} already, and case makes no difference: "
            "choose another name",
            code="unique",
        )


def equal_names() -> Iterator[str]:
    """A line for each name that several accounts have, in different case."""
    names = list(User.objects.order_by("pk").values_list("username", flat=True))
    for folded, count in Counter(map(str.casefold, names)).items():
        if count > 1:
            equal = " and ".join(name for name in names if name.casefold() == folded)
            yield f"The accounts {equal} differ only in case: rename or delete all but one of them"


def _before(instance: Any, raw: bool, update_fields: frozenset[str] | None, **_: Any) -> None:
    """Keep the stored row, to compare with, where something is saved that is logged."""
    instance.stored_before = None
    if raw or (update_fields is not None and not RECORDED & update_fields):
        return
    if instance.pk is not None:
        instance.stored_before = type(instance)._default_manager.filter(pk=instance.pk).first()
    stored = instance.stored_before
    if isinstance(instance, User) and (stored is None or stored.username != instance.username):
        check_name(instance.username, instance.pk)


def _after(instance: Any, created: bool, raw: bool, update_fields: frozenset[str] | None, **_: Any) -> None:
    stored = instance.stored_before
    if raw or (stored is None and not created):
        return
    if created:
        _record(instance, "created", ", ".join(flag for flag in FLAGS if getattr(instance, flag, False)))
        return
    if str(stored) != str(instance):
        _record(instance, "renamed", f"before: {stored}")
    for flag in FLAGS:
        if getattr(stored, flag, None) != (now := getattr(instance, flag, None)):
            _record(instance, f"{flag} {'set' if now else 'taken away'}")
    password_before, password = getattr(stored, "password", None), getattr(instance, "password", None)
    if password_before != password and not (update_fields == REHASH and instance._password is None):
        _record(instance, "password changed")


def _deleted(instance: Any, **_: Any) -> None:
    _record(instance, "deleted")


def _members_changed(
    sender: type[Model],
    instance: Any,
    action: str,
    reverse: bool,
    model: type[Model],
    pk_set: set[int] | None,
    **_: Any,
) -> None:
    """Log the groups and permissions of accounts, and the permissions of groups, from whichever side."""
    if action not in (ADDED, REMOVED, EMPTIED):
        return
    near, far = instance._meta.model_name, model._meta.model_name
    if action == EMPTIED:
        members = sender._default_manager.filter(**{f"{near}_id": instance.pk})
        pk_set = set(members.values_list(f"{far}_id", flat=True))
    verb = "added" if action == ADDED else "removed"
    for other in model._default_manager.filter(pk__in=pk_set or ()):
        owner, given = (other, instance) if reverse else (instance, other)
        _record(owner, f"{given._meta.model_name} {verb}", str(given))


def _record(subject: Any, action: str, note: str = "") -> None:
    kind = "account" if isinstance(subject, User) else "role"
    record_by_current(action, f"{kind} {subject}", "; ".join(filter(None, (f"id {subject.pk}", note))))
