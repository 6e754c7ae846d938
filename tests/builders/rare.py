"""A phone that few people have, and what the public may not see of it."""

import re
from collections.abc import Callable
from typing import Any

from crowd.devices.disclosure import public_device
from crowd.devices.models import DeviceModel
from crowd.results.figures import reassigning
from crowd.results.figures import sessions as session_figures
from crowd.results.privacy import disclosure_sync
from tests.builders.documents import device_document, session_document, submission_document
from tests.builders.participant import Participant

Join = Callable[[], Participant]

NAMED = "google-pixel-8"
CHIP = "Google Tensor G3 device"
# What of a phone's own strings may be nowhere in public while the phone is rare.
TELLING = ("Pixel 8", "pixel-8", "husky-build-77", "3a7f")


def measure(who: Participant, best_us: int = 10_000, **changes: Any) -> dict[str, Any]:
    """One session of `who` on a phone whose strings tell more than its model; the stored session's
    document."""
    device = device_document() | {
        "board": "husky-build-77",
        "opencl_driver": "3.0 v1.r44p1-00eac0.3a7f",
    }
    session = session_document(best_us=best_us)
    answer = who.submit(submission_document(session, device=device, **changes))
    assert answer.status_code == 202, answer.content
    return session


def work() -> None:
    """A worker does what waits."""
    disclosure_sync.sync_disclosure(reassigning.reassign_sessions(reassigning.changed_models()))
    session_figures.summarise_waiting()


def chip_of(name: str) -> str:
    """The public `name` of a masked model without the letters of its mask."""
    found = re.fullmatch(r"(.+) \([a-z]{4}\)", name)
    assert found, name
    return found[1]


def masked() -> str:
    """The public address of the phone, which has a mask."""
    device = public_device(DeviceModel.objects.get(slug=NAMED))
    assert device.masked
    return device.slug
