"""The first page's sections: what an administrator does, and the lists that belong to it.

Django groups lists by application, which says how the code is arranged. Here each list has a place by its
purpose, and a line that says what it is for. A list without a place is shown under "Other".
"""

from collections.abc import Iterable
from typing import Any

# Section: (title, what it is for, {application.Model: what the list is for}).
SECTIONS: tuple[tuple[str, str, dict[str, str]], ...] = (
    (
        "Publish",
        "What clients measure, and what everybody can read.",
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
        "What the crowd sent, and what the rules are not sure of.",
        {
            "results.MeasurementSession": "hide a session, or let it count",
            "results.Run": "one configuration over the sequence",
            "results.SessionSummary": "the speedups of each session",
            "results.DeviceSpeedup": "the figures that pages show",
            "results.Submission": "requests as they arrived",
            "results.Decision": "who hid or released what, and why",
            "devices.DeviceModel": "mark unknown devices and emulators; merge models",
            "devices.DeviceAlias": "accept or refuse that two names are one device",
            "devices.DeviceDescription": "what devices said of themselves; split a model",
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


def by_purpose(applications: Iterable[dict[str, Any]], index: str) -> list[dict[str, Any]]:
    """APPLICATIONS, Django's list of lists, in the sections above; empty sections are left out.

    INDEX is the address of the first page: a section's address is its place there.
    """
    models = {
        f"{application['app_label']}.{model['object_name']}": model
        for application in applications
        for model in application["models"]
    }
    found = []
    for title, purpose, meanings in SECTIONS:
        own = [
            models.pop(label) | {"meaning": meaning} for label, meaning in meanings.items() if label in models
        ]
        found.append((title, purpose, own))
    found.append((*OTHER, [model | {"meaning": ""} for model in models.values()]))
    return [
        {
            "name": title,
            "purpose": purpose,
            "app_label": title.lower(),
            "app_url": f"{index}#{title.lower()}",
            "has_module_perms": True,
            "models": own,
        }
        for title, purpose, own in found
        if own
    ]
