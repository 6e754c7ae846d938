"""The sections of the admin index.

Django groups models by application, which mirrors the code. Here they are grouped by what an administrator
does, and each has a line that says what it is for. A model without a section is shown under "Other".
"""

from collections.abc import Iterable
from typing import Any

# (title, purpose, {application.Model: what its list is for})
SECTIONS: tuple[tuple[str, str, dict[str, str]], ...] = (
    (
        "Publish",
        "What clients measure, and what everyone can read.",
        {
            "fronts.FrontVersion": "review, publish and retire fronts",
            "fronts.IntakePolicy": "open or close the intake of measurements",
            "results.Export": "files of the open data",
        },
    ),
    (
        "Explore",
        "Searches on reference devices, and what the crowd's measurements predict.",
        {
            "explorations.Exploration": "start and steer a search; choose its points",
            "explorations.Evaluation": "each measurement of a search",
            "explorations.ReferenceDevice": "machines that measure, and their tokens",
            "predictions.ProbeRequest": "ask the crowd to measure a configuration",
            "predictions.ProbeAssignment": "what clients were asked to measure",
            "predictions.DeviceMap": "models of how devices differ",
            "predictions.Recommendation": "what was recommended for a device",
        },
    ),
    (
        "Review",
        "What the crowd sent, and what the rules cannot decide.",
        {
            "results.MeasurementSession": "hide a session, or let it count",
            "results.Run": "one configuration over the sequence",
            "results.SessionSummary": "the speedups of each session",
            "results.DeviceSpeedup": "the figures that pages show",
            "results.Submission": "requests as they arrived",
            "results.Decision": "who hid or released what, and why",
            "devices.DeviceModel": "mark unknown devices and emulators; merge models",
            "devices.DeviceAlias": "decide whether two names are one device",
            "devices.DeviceDescription": "what devices reported; split a model",
            "devices.DeviceSplit": "models that were split",
            "devices.CatalogueEntry": "market names that were imported",
            "devices.AttemptCount": "how far visitors of the measuring page came",
        },
    ),
    (
        "People",
        "Accounts of administrators, participants, and the log.",
        {
            "auth.User": "accounts and passwords",
            "auth.Group": "roles: editors prepare, publishers decide",
            "otp_totp.TOTPDevice": "one-time passwords for accounts",
            "devices.Installation": "clients that take part; end a token",
            "results.Tombstone": "erase measurements; what was erased",
            "audit.AuditEntry": "who did what",
        },
    ),
)
OTHER = ("Other", "Lists without a section.")


def group_by_purpose(applications: Iterable[dict[str, Any]], index: str) -> list[dict[str, Any]]:
    """`applications`, as Django lists them, regrouped by SECTIONS; empty sections are left out.

    `index` is the address of the index: a section's address is an anchor on it.
    """
    models = {
        f"{application['app_label']}.{model['object_name']}": model
        for application in applications
        for model in application["models"]
    }
    sections = []
    for title, purpose, meanings in SECTIONS:
        its_models = [
            models.pop(label) | {"meaning": meaning} for label, meaning in meanings.items() if label in models
        ]
        sections.append((title, purpose, its_models))
    sections.append((*OTHER, [model | {"meaning": ""} for model in models.values()]))
    return [
        {
            "name": title,
            "purpose": purpose,
            "app_label": title.lower(),
            "app_url": f"{index}#{title.lower()}",
            "has_module_perms": True,
            "models": shown,
        }
        for title, purpose, shown in sections
        if shown
    ]
