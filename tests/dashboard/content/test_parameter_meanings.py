"""Fronts and their files say what each parameter means, and in which unit."""

import pytest
from django.test import Client

from crowd.dashboard.content.parameter_meanings import meaning_of
from crowd.fronts.models import FrontVersion


def test_a_meaning_ends_with_its_unit() -> None:
    assert meaning_of("mu") == "truncation distance of the signed distance field (m)"
    assert meaning_of("integration_rate") == "every n-th frame is fused into the volume"
    assert meaning_of("block") == ""


@pytest.mark.django_db
def test_pages_of_the_front_and_of_the_data_say_what_parameters_mean(
    client: Client, front: FrontVersion
) -> None:
    of_front = client.get(f"/fronts/{front.slug}/").content.decode()
    data = client.get("/data/").content.decode()

    assert f'title="{meaning_of("volume_resolution")}"' in of_front
    assert "truncation distance of the signed distance field" in data
