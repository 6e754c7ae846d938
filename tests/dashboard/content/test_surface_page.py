"""The page of the response surface, and its numbers."""

import csv
import io

import pytest
from django.test import Client

from tests.dashboard.reading import read

pytestmark = pytest.mark.django_db


def test_the_page_says_what_the_surface_shows_and_where_it_was_measured(client: Client) -> None:
    page = read(client, "/surface/")

    assert "All 80 configurations are valid" in page
    assert "n = 80 configurations, each measured once on one device" in page
    assert "python -m slam surface --x mu --x-values 0.025,0.05," in page
    assert "pthread-haswell-AMD EPYC" in page
    assert "keeps its default, except compute size ratio: 1 instead of 2." in page
    assert "Measured; the data come with Frontrunner and are in no release of the open data" in page


def test_an_application_without_a_surface_has_no_such_page(client: Client) -> None:
    assert client.get("/surface/?application=none").status_code == 404
    assert client.get("/figures/surface/runtime.json?application=none").status_code == 404
    assert client.get("/surface/?application=kfusion").status_code == 200


def test_both_maps_have_their_numbers_beside_them(client: Client) -> None:
    figure = client.get("/figures/surface/runtime.json").json()
    rows = list(csv.DictReader(io.StringIO(client.get("/tables/surface/error.csv").content.decode())))

    assert len(figure["data"][0]["z"]) == 8
    assert len(rows) == 80
    assert float(rows[0]["ate_max_m"]) < 0.05
