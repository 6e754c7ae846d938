"""What administrators write down and look at."""

from typing import Any

import pytest
from django.contrib.auth.models import Group, User
from django.test import Client

from crowd.access.roles import EDITOR
from crowd.fronts.models import Configuration
from crowd.predictions import maps
from crowd.predictions.models import ProbeRequest
from tests.builders.known_front import NAME
from tests.builders.measured import Measured
from tests.predictions.test_assigning import assign, names
from tests.predictions.test_recommending import DIFFERENT

ADMIN = "/admin/predictions"


@pytest.fixture
def editor(client: Client, db: None) -> Client:
    user = User.objects.create_user("editor", is_staff=True)
    user.groups.add(Group.objects.get(name=EDITOR))
    client.force_login(user)
    return client


@pytest.mark.slow
def test_an_editor_asks_for_a_configuration_on_a_kind_of_chip(editor: Client, measured: Any) -> None:
    device: Measured = measured()
    fast3 = Configuration.objects.get(name="fast3")
    page = editor.get(f"{ADMIN}/proberequest/add/")
    assert f"{NAME} fast3" in page.content.decode()

    answer = editor.post(
        f"{ADMIN}/proberequest/add/",
        {"configuration": fast3.pk, "chip": "Mali", "sessions": 2, "reason": "fast3 on Mali", "active": "on"},
    )

    assert answer.status_code == 302
    assert str(ProbeRequest.objects.get()) == f"{NAME} fast3 on Mali"
    assert names(assign(device))[0] == "fast3"
    assert f"{NAME} fast3" in editor.get(f"{ADMIN}/probeassignment/").content.decode()


@pytest.mark.slow
def test_what_was_learned_and_recommended_is_shown_and_cannot_be_changed(
    editor: Client, measured: Any
) -> None:
    measured(**DIFFERENT)
    [row] = maps.rebuild()

    for kind in ("devicemap", "recommendation", "probeassignment"):
        assert editor.get(f"{ADMIN}/{kind}/").status_code == 200
        assert editor.get(f"{ADMIN}/{kind}/add/").status_code == 403
    shown = editor.get(f"{ADMIN}/devicemap/{row.pk}/change/").content.decode()
    assert "stages" in shown
    assert 'name="_save"' not in shown
