"""Fronts as releases before the present checks left them in a database."""

from typing import Any

from django.utils import timezone

from crowd.fronts import trajectories
from crowd.fronts.content import front_file
from crowd.fronts.models import Configuration, FrontVersion
from tests.crowd.documents import front_document


def of_protocol_1(pack: dict[str, Any], version: str = "1") -> FrontVersion:
    """A published front of protocol 1."""
    return publish_unchecked(document_of_protocol_1(pack, version), pack)


def document_of_protocol_1(pack: dict[str, Any], version: str = "1") -> dict[str, Any]:
    """A front of the protocol that repeated runs until the interval was narrow."""
    document = front_file.without_preparation(front_document(pack, version))
    document["protocol"] |= {"version": 1, "max_repeats": 6}
    return document


def publish_unchecked(document: dict[str, Any], pack: dict[str, Any]) -> FrontVersion:
    """DOCUMENT as a published front, whatever its checks say."""
    front = FrontVersion.objects.create(
        slug=f"kfusion-{document['version']}",
        application="kfusion",
        version=document["version"],
        digest=front_file.digest(document),
        protocol=document["protocol"],
        sequence=pack,
        provenance=document["provenance"],
    )
    for position, point in enumerate(document["configurations"]):
        stored = dict(point)
        if "trajectory" in stored:
            stored["trajectory"] = trajectories.store(stored["trajectory"])
        Configuration.objects.create(front=front, position=position, **stored)
    for state in ("in-review", "published"):
        front.refresh_from_db()  # PostgreSQL writes numbers in its own way
        front.state, front.published_at = state, timezone.now()
        front.save()
    return front
