"""Writes of fronts: a draft, its publication, its retirement. Each is one transaction."""

import json
from pathlib import Path
from typing import Any

from django.db import transaction
from django.utils import timezone

from crowd.fronts import contents, sequences
from crowd.fronts.models import Configuration, FrontVersion


class FrontConflictError(ValueError):
    """Different content under a version that is already published; the remedy is a new version."""


@transaction.atomic
def create_draft(document: dict[str, Any]) -> FrontVersion:
    """A draft with DOCUMENT's content (a front file's shape); an earlier draft of that version is replaced.

    Raises InvalidFrontError, SequenceError, or FrontConflictError where the version is already published.
    """
    content = contents.check(document)
    version = str(content.version)
    slug = f"{content.application}-{version}"
    stored = FrontVersion.objects.filter(slug=slug).first()
    if stored is not None and stored.state != FrontVersion.State.DRAFT:
        raise FrontConflictError(f"{slug} is published: give this content another version")
    if stored is not None:
        stored.delete()
    front = FrontVersion.objects.create(
        slug=slug,
        application=content.application,
        version=version,
        digest=contents.digest(document),
        protocol=document["protocol"],
        sequence=sequences.describe(content.sequence.name, content.sequence.sha256),
        provenance=document["provenance"],
    )
    Configuration.objects.bulk_create(
        Configuration(
            front=front,
            name=point["name"],
            position=position,
            parameters=point["parameters"],
            predicted=point["predicted"],
        )
        for position, point in enumerate(document["configurations"])
    )
    return front


@transaction.atomic
def publish(front: FrontVersion) -> FrontVersion:
    """Make a draft what clients measure, for good. A front that is published already stays as it is."""
    if front.state == FrontVersion.State.DRAFT:
        front.state = FrontVersion.State.PUBLISHED
        front.published_at = timezone.now()
        front.save()
    return front


def retire(front: FrontVersion) -> FrontVersion:
    """No client is told to measure it any more; its results stay, and late ones are still accepted."""
    if front.state == FrontVersion.State.PUBLISHED:
        front.state = FrontVersion.State.RETIRED
        front.retired_at = timezone.now()
        front.save()
    return front


@transaction.atomic
def publish_content(document: dict[str, Any]) -> tuple[FrontVersion, bool]:
    """Publish DOCUMENT, and whether that was new. The same content again changes nothing.

    Raises what create_draft raises.
    """
    content = contents.check(document)
    stored = FrontVersion.objects.filter(
        application=content.application, version=str(content.version)
    ).first()
    if stored is not None and stored.state != FrontVersion.State.DRAFT:
        if stored.digest != contents.digest(document):
            raise FrontConflictError(
                f"{stored.slug} is published with other content (digest {stored.digest[:12]}...): "
                "give the changed front another version"
            )
        return stored, False
    return publish(create_draft(document)), True


def publish_file(path: Path) -> tuple[FrontVersion, bool]:
    """Publish the front in the JSON file PATH; raises InvalidFrontError also where it is no JSON."""
    try:
        document = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise contents.InvalidFrontError(f"{path} cannot be read as JSON: {error}") from error
    try:
        return publish_content(document)
    except (contents.InvalidFrontError, sequences.SequenceError, FrontConflictError) as error:
        raise type(error)(f"{path}: {error}") from error
