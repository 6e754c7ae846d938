"""Which figures are confirmed: by three networks of their own model, or by other models with their chip."""

from typing import Any

import pytest

from crowd.devices.aliases import decisions
from crowd.devices.models import DeviceModel, Installation
from crowd.results import tasks
from crowd.results.figures import confirmation
from crowd.results.models import DeviceSpeedup
from crowd.results.privacy.erasure import erase_installation
from tests.builders.crowds import Join, crowd
from tests.builders.participant import Participant

MALI, ADRENO = "Mali-G715", "QUALCOMM Adreno(TM) 740"
ALIKE = [2.0, 2.0, 2.0]
PIXELS = ("Pixel 8", "Pixel 8 Pro", "Pixel 8a")
GALAXY: dict[str, Any] = {"manufacturer": "samsung", "opencl_device": ADRENO}


@pytest.fixture(autouse=True)
def of_three(settings: Any, front: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 3


@pytest.fixture
def honest(of_three: None, join: Join) -> None:
    """A model of each of two chips, from three networks."""
    crowd(join, {"Pixel 8": ALIKE})
    crowd(join, {"SM-S911B": ALIKE}, **GALAXY)


@pytest.fixture
def supported_at_home(honest: None, join: Join) -> Participant:
    """The network `home` supports a Pixel 8 Pro, and so not a Galaxy, too."""
    [first] = crowd(join, {"Pixel 8 Pro": 2.0}, network="home")
    confirmed()
    crowd(join, {"SM-S916B": 2.0}, network="home", **GALAXY)
    assert ("SM-S916B", "Adreno 740") not in confirmed()
    return first


def confirmed() -> set[tuple[str, str]]:
    """Names and chips of the models with a confirmed figure, once all chips were asked."""
    confirmation.update_chip_witnesses()
    rows = DeviceSpeedup.objects.filter(confirmation.confirmed())
    return set(rows.values_list("device__name", "processor"))


def test_three_networks_of_one_model_confirm_it(join: Join) -> None:
    crowd(join, {"Pixel 8": [2.0, 2.0]})
    assert confirmed() == set()

    crowd(join, {"Pixel 8": 2.0})

    assert confirmed() == {("Pixel 8", MALI)}


def test_many_installations_of_one_network_confirm_nothing(join: Join) -> None:
    crowd(join, {"Pixel 8": [2.0] * 5}, network="one")

    assert confirmed() == set()


def test_other_models_with_the_chip_confirm_a_figure(join: Join) -> None:
    crowd(join, dict.fromkeys(PIXELS, 2.0))

    assert confirmed() == {(model, MALI) for model in PIXELS}


def test_a_figure_is_confirmed_no_more_once_a_witness_is_erased(join: Join) -> None:
    first, *_ = crowd(join, dict.fromkeys(PIXELS, 2.0))
    assert len(confirmed()) == len(PIXELS)

    erase_installation(Installation.objects.get(pk=first.installation_id))

    assert confirmed() == set()


def test_another_class_of_processor_confirms_nothing(join: Join) -> None:
    crowd(join, dict.fromkeys(PIXELS[:2], 2.0))
    processor = {"opencl_device": "pthread-cortex-a78", "opencl_platform": "Portable Computing Language"}
    crowd(join, {"Pixel 8a": 2.0}, **processor)

    assert confirmed() == set()


def test_a_figure_far_from_its_chip_is_not_confirmed(join: Join) -> None:
    crowd(join, {"Pixel 8": ALIKE, "Pixel 8 Pro": 4.0})

    assert confirmed() == {("Pixel 8", MALI)}


def test_models_of_unknown_names_do_not_confirm_others_with_their_chip(join: Join) -> None:
    crowd(join, {"Pixel 8": 2.0, "Invented 0": 2.0, "Invented 1": 2.0, "Invented 2": 2.0})

    assert confirmed() == set()


def test_an_administrator_makes_a_name_known(join: Join) -> None:
    models = ("Pixel 8", "Pixel 8 Pro", "Invented")
    crowd(join, dict.fromkeys(models, 2.0))
    assert confirmed() == set()

    decisions.set_kind(DeviceModel.objects.filter(name="Invented"), DeviceModel.Kind.DEVICE, "anna")
    tasks.sweep()

    assert confirmed() == {(model, MALI) for model in models}


@pytest.mark.slow
def test_a_network_has_one_model_that_its_chip_confirms(honest: None, join: Join) -> None:
    before = confirmed()

    invented = {f"Invented {number}": 2.2 for number in range(4)}
    crowd(join, invented, network="one")
    crowd(join, invented | {"Pixel 8": [2.2] * 4}, network="one", opencl_device=ADRENO)

    assert len(confirmed() - before) == 1


def test_an_earlier_figure_of_a_network_stays_confirmed(join: Join) -> None:
    crowd(join, {"Pixel 8": ALIKE})
    crowd(join, {"Pixel 8 Pro": 2.0}, network="home")
    before = confirmed()

    crowd(join, {"Pixel 7": 2.0}, network="home")

    assert confirmed() == before == {("Pixel 8", MALI), ("Pixel 8 Pro", MALI)}


def test_a_network_supports_another_model_once_the_first_is_erased(supported_at_home: Participant) -> None:
    erase_installation(Installation.objects.get(pk=supported_at_home.installation_id))

    assert ("SM-S916B", "Adreno 740") in confirmed()


@pytest.mark.slow
def test_a_network_supports_another_model_once_the_first_has_its_own_networks(
    supported_at_home: Participant, join: Join
) -> None:
    crowd(join, {"Pixel 8 Pro": [2.0, 2.0]})
    confirmed()

    assert ("SM-S916B", "Adreno 740") in confirmed()
