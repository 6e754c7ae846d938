"""Roles: editors prepare, publishers decide. Every migration creates their groups."""

from typing import Any

from django.apps import AppConfig
from django.apps import apps as installed
from django.apps.registry import Apps
from django.contrib.auth.management import create_permissions

EDITOR, PUBLISHER = "editor", "publisher"

# Permissions of both roles, by application. Publishers also have _DECIDING.
_BOTH = {
    "audit": ("view_auditentry",),
    "fronts": ("view_frontversion", "view_configuration", "submit_frontversion"),
    "explorations": (
        *("view_exploration", "add_exploration", "change_exploration", "view_evaluation"),
        *("view_referencedevice", "add_referencedevice", "change_referencedevice"),
    ),
    "results": (
        *("view_submission", "view_measurementsession", "view_run", "view_sessionsummary"),
        "view_devicespeedup",
    ),
    "predictions": (
        *("view_devicemap", "view_probeassignment", "view_recommendation"),
        *("view_proberequest", "add_proberequest", "change_proberequest"),
    ),
    "devices": (
        *("view_devicemodel", "view_devicedescription", "view_devicealias", "view_devicesplit"),
        *("view_catalogueentry", "view_attemptcount"),
    ),
}
_DECIDING = {"fronts": ("publish_frontversion",), "devices": ("change_devicemodel",)}


def grant(app_config: AppConfig, using: str = "default", apps: Apps = installed, **_: Any) -> None:
    """Give the roles their permissions of one application. Permissions that an administrator added stay."""
    label = app_config.label
    if label not in _BOTH:
        return
    try:
        group_model, permission_model = apps.get_model("auth", "Group"), apps.get_model("auth", "Permission")
    except LookupError:  # only some applications are migrated, and accounts come later
        return
    # Django creates permissions on the same signal, perhaps later.
    create_permissions(app_config, verbosity=0, interactive=False, using=using, apps=apps)
    groups, permissions = group_model.objects.using(using), permission_model.objects.using(using)
    # In bulk: the audit log holds what people grant.
    groups.bulk_create([group_model(name=role) for role in (EDITOR, PUBLISHER)], ignore_conflicts=True)
    granted = group_model.permissions.through
    for role, codenames in (
        (EDITOR, _BOTH[label]),
        (PUBLISHER, _BOTH[label] + _DECIDING.get(label, ())),
    ):
        group = groups.get(name=role)
        wanted = permissions.filter(content_type__app_label=label, codename__in=codenames)
        granted.objects.using(using).bulk_create(
            [granted(group_id=group.pk, permission_id=permission.pk) for permission in wanted],
            ignore_conflicts=True,
        )
