"""The administration's overview of what waits."""

from html import unescape

import pytest
from django.contrib.auth.models import Permission, User
from django.test import Client
from django.urls import reverse
from django.utils import timezone

from crowd.dashboard.content.review_queues import Queue, waiting
from crowd.devices.models import DeviceModel
from crowd.fronts.models import FrontVersion
from crowd.results import moderation
from crowd.results.models import MeasurementSession
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.builders.stored import join
from tests.dashboard.reading import text

pytestmark = pytest.mark.django_db


def queues() -> dict[str, Queue]:
    return {queue.title: queue for queue in waiting(lambda _: True, timezone.now())}


def test_what_waits_is_counted_and_each_list_holds_as_many(
    client: Client, participant: Participant, admin_client: Client
) -> None:
    now = timezone.now().isoformat()
    measure(participant, started_at=now)
    measure(join(), "Pixel 7", started_at=now)
    session = MeasurementSession.objects.order_by("pk").first()
    assert session is not None
    moderation.decide("quarantine", "ada", "measured on a bench", session)
    DeviceModel.objects.update(kind=DeviceModel.Kind.UNKNOWN)

    found = queues()

    assert (found["Quarantined"].count, found["Suspect"].count) == (1, 0)
    assert found["Unknown devices"].count == DeviceModel.objects.count() > 1
    for queue in found.values():
        listed = admin_client.get(queue.address)
        assert listed.status_code == 200, queue.title
        assert listed.context["cl"].result_count == queue.count, queue.title


def test_the_overview_shows_the_queues_of_the_lists_that_the_account_may_see(
    client: Client, front: FrontVersion
) -> None:
    user = User.objects.create_user("ada", password="correct horse battery", is_staff=True)
    user.user_permissions.add(Permission.objects.get(codename="view_devicealias"))
    client.force_login(user)

    page = client.get(reverse("admin:index"))

    assert "Proposed aliases two names that may be one device: accept or refuse 0" in text(page)
    assert "Quarantined" not in text(page)
    assert queues()["Proposed aliases"].address in unescape(page.content.decode())
