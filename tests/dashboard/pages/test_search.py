"""A device is found by what people type."""

from typing import Any

import pytest
from django.test import Client

from crowd.devices import revision
from crowd.devices.aliases.decisions import decide
from crowd.devices.catalogue import CatalogueLine, store
from crowd.devices.models import DeviceAlias, DeviceModel
from crowd.devices.naming.spelling import Vocabulary, is_one_edit_away, words
from crowd.fronts.models import FrontVersion
from crowd.results.figures import reassigning
from crowd.results.figures.sessions import summarise_waiting
from crowd.results.reading.search import search
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.builders.stored import join
from tests.dashboard.reading import read, text

pytestmark = pytest.mark.django_db


CATALOGUE = (
    CatalogueLine(1, "samsung", "Galaxy S6", "zeroflte", "SM-G920F", "Samsung Exynos7420", "ARM Mali T760"),
    CatalogueLine(2, "samsung", "Galaxy S6", "zerolte", "SM-G920I", "Samsung Exynos7420", "ARM Mali T760"),
    CatalogueLine(3, "google", "Pixel 8", "shiba", "Pixel 8", "Google Tensor G3", "ARM Mali G715"),
)


def slugs_for(query: str) -> list[str]:
    """The addresses of the measured devices that fit `query`, in their order."""
    return [row.device.slug for row in search(query).devices]


@pytest.mark.parametrize(
    ("typed", "word"),
    [("galxy", "galaxy"), ("galaxyy", "galaxy"), ("gakaxy", "galaxy"), ("glaaxy", "galaxy")],
)
def test_one_wrong_letter_is_forgiven(typed: str, word: str) -> None:
    assert is_one_edit_away(typed, word)
    assert Vocabulary(["Galaxy S6", "Pixel 8"]).correct(typed) == word


@pytest.mark.parametrize(("typed", "word"), [("galaxy", "galaxy"), ("gxlxxy", "galaxy"), ("pixel", "galaxy")])
def test_more_than_one_wrong_letter_is_another_word(typed: str, word: str) -> None:
    assert not is_one_edit_away(typed, word)


def test_codes_and_short_words_are_never_corrected() -> None:
    vocabulary = Vocabulary(["SM-G920F", "Mali", "Galaxy S6"])

    assert vocabulary.correct("g920x") == "g920x"
    assert vocabulary.correct("mal") == "mal"
    assert vocabulary.correct("galxa") == "galaxy", "the beginning of a word, while somebody types"
    assert words("Galaxy S9+ (SM-G965F)") == ["galaxy", "s9+", "sm", "g965f"]


@pytest.mark.slow
@pytest.mark.parametrize("query", ["pixel", "Google pix", "8 pixel", "tensor g3", "arm mali", "pixxel 8"])
def test_a_device_is_found_by_name_maker_and_chip(participant: Participant, query: str) -> None:
    measure(participant)

    assert slugs_for(query) == ["google-pixel-8"]


def test_the_closest_name_comes_first(front: FrontVersion) -> None:
    for name in ("Pixel 8 Pro", "Pixel 8", "Pixel 7"):
        measure(join(), name)

    assert slugs_for("pixel 8") == ["google-pixel-8", "google-pixel-8-pro"]
    assert slugs_for("pixel") == ["google-pixel-7", "google-pixel-8", "google-pixel-8-pro"]
    assert slugs_for("galaxy pixel") == []


def test_a_masked_model_is_found_by_its_chip_alone(
    client: Client, participant: Participant, settings: Any
) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    measure(participant)
    store(CATALOGUE)

    [slug] = slugs_for("tensor g3")
    assert "pixel" not in slug
    assert slugs_for("pixel 8") == []
    page = read(client, "/search/?q=Pixel+8")
    assert "It was not measured yet, or by fewer than 5 people" in page, "as if it had not been measured"
    assert slug not in client.get("/search/?q=Pixel+8").content.decode()


def test_a_known_device_that_nobody_measured_says_how_to_take_part(
    client: Client, front: FrontVersion
) -> None:
    store(CATALOGUE)

    response = client.get("/search/?q=galaxi+s6")

    page = text(response)
    assert "These are the results for galaxy s6" in page
    assert "Known, without a figure under its name" in page
    assert "Samsung Galaxy S6 SM-G920F, SM-G920I" in page
    assert 'href="/measure/"' in response.content.decode()


def test_another_code_of_a_measured_model_finds_the_model(participant: Participant) -> None:
    measure(participant)
    store((CatalogueLine(1, "google", "Pixel 8", "shiba", "GKWS6", "", ""),))

    result = search("GKWS6")

    assert [row.device.slug for row in result.devices] == ["google-pixel-8"]
    assert result.unmeasured == ()


def test_a_former_name_finds_the_model_unless_few_had_it(front: FrontVersion, settings: Any) -> None:
    measure(join(), "Pixel 8")
    measure(join(), "Nexus 5X")
    alias = DeviceModel.objects.get(name="Nexus 5X")
    model = DeviceModel.objects.get(slug="google-pixel-8")
    proposal = DeviceAlias.objects.create(alias=alias, model=model, reason="test")
    decide(proposal, "an administrator", DeviceAlias.State.ACCEPTED)
    reassigning.reassign_sessions(reassigning.changed_models())
    summarise_waiting()

    assert slugs_for("nexus 5x") == ["google-pixel-8"]
    # Two people were enough to name the model, one is not enough for the alias.
    settings.FRONTRUNNER_RARE_BELOW = 2
    revision.bump()
    assert slugs_for("pixel") == ["google-pixel-8"]
    assert slugs_for("nexus") == []


def test_suggestions_are_a_list_alone(client: Client, participant: Participant) -> None:
    measure(participant)

    response = client.get("/search/?q=pix", headers={"HX-Request": "true"})

    assert "<html" not in response.content.decode()
    assert text(response) == "Google Pixel 8 8.00x All results for “pix”"
    assert "HX-Request" in response["Vary"]


def test_a_search_without_a_match_says_what_to_do(client: Client, front: FrontVersion) -> None:
    page = read(client, "/search/?q=phone+of+mine")

    assert "No device fits “phone of mine”" in page
    assert "search the guide" in page
    assert "Measure it in the browser" in page
    assert "Type a name" in read(client, "/search/")
    assert "Type a name" in read(client, "/search/?q=%20")


@pytest.mark.parametrize("address", ["/", "/devices/", "/fronts/", "/about/", "/compare/", "/api/v1/docs"])
def test_every_page_has_one_search_field_and_the_footer(
    client: Client, front: FrontVersion, settings: Any, address: str
) -> None:
    settings.FRONTRUNNER_SOURCE = "https://example.org/project"

    page = client.get(address).content.decode()

    assert page.count('name="q"') == 1
    footer = page.partition("<footer")[2]
    for linked in ("https://example.org/project", "/api/v1/docs", "/data/", "/guide/", "/about/#privacy"):
        assert f'href="{linked}"' in footer, linked


def test_searching_asks_the_database_seldom(front: FrontVersion, django_assert_max_num_queries: Any) -> None:
    for number in range(4):
        measure(join(), f"Pixel {number}")

    with django_assert_max_num_queries(22):
        search("pixel")
    with django_assert_max_num_queries(2):
        search("pixel 3")
