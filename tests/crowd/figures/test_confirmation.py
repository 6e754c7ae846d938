"""Which figures are confirmed: by three networks of their own model, or by other models with their chip."""

from collections.abc import Callable
from typing import Any

import pytest

from crowd.devices.aliases import decisions
from crowd.devices.models import DeviceModel, Installation
from crowd.results import tasks
from crowd.results.figures import confirmation
from crowd.results.models import DeviceSpeedup
from crowd.results.privacy.erasure import erase_installation
from tests.builders.documents import device_document, session_document, submission_document
from tests.builders.participant import Participant

Join = Callable[[], Participant]
MALI, ADRENO = "Mali-G715", "QUALCOMM Adreno(TM) 740"


@pytest.fixture(autouse=True)
def of_three(settings: Any, front: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 3


@pytest.fixture
def send(join: Join) -> Callable[..., Participant]:
    """One more installation, from a network of its own or from NETWORK, that measured MODEL twice as fast."""

    def sent(
        model: str, network: str = "", chip: str = MALI, speedup: float = 2.0, **device: Any
    ) -> Participant:
        participant = join()
        if network:
            Installation.objects.filter(pk=participant.installation_id).update(network=network)
        described = device_document(model, opencl_device=chip, **device)
        session = session_document(default_us=80_000, best_us=round(80_000 / speedup))
        assert participant.submit(submission_document(session, device=described)).status_code == 202
        return participant

    return sent


def confirmed() -> set[tuple[str, str]]:
    """Names and chips of the models with a confirmed figure, once all chips were asked."""
    confirmation.update_chip_witnesses()
    rows = DeviceSpeedup.objects.filter(confirmation.confirmed())
    return set(rows.values_list("device__name", "processor"))


def test_three_networks_of_one_model_confirm_it(send: Callable[..., Participant]) -> None:
    send("Pixel 8")
    send("Pixel 8")
    assert confirmed() == set()

    send("Pixel 8")

    assert confirmed() == {("Pixel 8", "Mali-G715")}


def test_many_installations_of_one_network_confirm_nothing(send: Callable[..., Participant]) -> None:
    for _ in range(5):
        send("Pixel 8", network="one")

    assert confirmed() == set()


def test_other_models_with_the_chip_confirm_a_figure(send: Callable[..., Participant]) -> None:
    for model in ("Pixel 8", "Pixel 8 Pro", "Pixel 8a"):
        send(model)

    assert confirmed() == {(model, "Mali-G715") for model in ("Pixel 8", "Pixel 8 Pro", "Pixel 8a")}


def test_another_class_of_processor_confirms_nothing(send: Callable[..., Participant]) -> None:
    for model in ("Pixel 8", "Pixel 8 Pro"):
        send(model)
    send("Pixel 8a", chip="pthread-cortex-a78", opencl_platform="Portable Computing Language")

    assert confirmed() == set()


def test_a_figure_far_from_its_chip_is_not_confirmed(send: Callable[..., Participant]) -> None:
    for _ in range(3):
        send("Pixel 8")
    send("Pixel 8 Pro", speedup=4.0)

    assert confirmed() == {("Pixel 8", "Mali-G715")}


def test_models_of_unknown_names_do_not_confirm_others_with_their_chip(
    send: Callable[..., Participant],
) -> None:
    send("Pixel 8")
    for number in range(3):
        send(f"Invented {number}")

    assert confirmed() == set()


def test_an_administrator_makes_a_name_known(send: Callable[..., Participant]) -> None:
    for model in ("Pixel 8", "Pixel 8 Pro", "Invented"):
        send(model)
    assert confirmed() == set()

    decisions.set_kind(DeviceModel.objects.filter(name="Invented"), DeviceModel.Kind.DEVICE, "anna")
    tasks.sweep()

    assert confirmed() == {(model, "Mali-G715") for model in ("Pixel 8", "Pixel 8 Pro", "Invented")}


@pytest.mark.slow
def test_a_network_has_one_model_that_its_chip_confirms(send: Callable[..., Participant]) -> None:
    for _ in range(3):
        send("Pixel 8")
        send("SM-S911B", chip=ADRENO, manufacturer="samsung")
    honest = confirmed()

    for number in range(4):
        send(f"Invented {number}", network="one", speedup=2.2)
        send(f"Invented {number}", network="one", chip=ADRENO, speedup=2.2)
        send("Pixel 8", network="one", chip=ADRENO, speedup=2.2)

    assert len(confirmed() - honest) == 1


def test_an_earlier_figure_of_a_network_stays_confirmed(send: Callable[..., Participant]) -> None:
    for _ in range(3):
        send("Pixel 8")
    send("Pixel 8 Pro", network="home")
    before = confirmed()

    send("Pixel 7", network="home")

    assert confirmed() == before == {("Pixel 8", "Mali-G715"), ("Pixel 8 Pro", "Mali-G715")}


def test_a_network_supports_another_model_once_the_first_is_erased(send: Callable[..., Participant]) -> None:
    for _ in range(3):
        send("Pixel 8")
        send("SM-S911B", chip=ADRENO, manufacturer="samsung")
    first = send("Pixel 8 Pro", network="home")
    confirmed()
    send("SM-S916B", network="home", chip=ADRENO, manufacturer="samsung")
    assert ("SM-S916B", "Adreno 740") not in confirmed()

    erase_installation(Installation.objects.get(pk=first.installation_id))

    assert ("SM-S916B", "Adreno 740") in confirmed()


@pytest.mark.slow
def test_a_network_supports_another_model_once_the_first_has_its_own_networks(
    send: Callable[..., Participant],
) -> None:
    for _ in range(3):
        send("Pixel 8")
        send("SM-S911B", chip=ADRENO, manufacturer="samsung")
    send("Pixel 8 Pro", network="home")
    confirmed()
    send("SM-S916B", network="home", chip=ADRENO, manufacturer="samsung")
    assert ("SM-S916B", "Adreno 740") not in confirmed()

    for _ in range(2):
        send("Pixel 8 Pro")
    confirmed()

    assert ("SM-S916B", "Adreno 740") in confirmed()
