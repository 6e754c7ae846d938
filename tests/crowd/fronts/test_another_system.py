"""A system is added by its definition: fronts, clients and pages know it then."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from client_kit.device import requirements
from client_kit.errors import CannotMeasureError
from crowd.dashboard import formats
from crowd.dashboard.content.parameter_meanings import meaning_of
from crowd.explorations.searching.baseline_configurations import baseline_configurations
from crowd.fronts.content import front_file, plans
from pareto import Space
from slam import definitions
from slam.configuration import ConfigurationError
from slam.system import Definition, Parameter
from tests.builders.documents import front_document


def complete(values: Mapping[str, object]) -> dict[str, object]:
    if unknown := set(values) - {"patience"}:
        raise ConfigurationError(f"{unknown.pop()}: not a parameter; patience is")
    return {"patience": 1} | dict(values)


SNAIL = Definition(
    title="SnailFusion",
    complete=complete,
    backends=("opencl",),
    colour=False,
    size_multiple=lambda _: 1,
    warm_up=dict,
    parameters={"patience": Parameter((1, 2, 3), "how long it waits", "frames")},
    stages={"tracking": "it crawls"},
    unattempted="it sleeps",
    known={"quick": {"patience": 1}},
    packages={"snail-tracks": "snail_tracks"},
)


@pytest.fixture(autouse=True)
def snail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(definitions.SYSTEMS, "snail", SNAIL)  # type: ignore[arg-type]


def test_clients_name_the_packages_that_it_needs() -> None:
    with pytest.raises(CannotMeasureError, match="snail needs snail-tracks, not installed here"):
        requirements.require("snail")


def test_pages_have_its_name_and_the_meanings_of_its_parameters() -> None:
    assert formats.application("snail") == "SnailFusion"
    assert meaning_of("patience") == "how long it waits (frames)"


def test_searches_start_from_what_others_know_of_it() -> None:
    space = Space.from_dict(
        {"name": "snail", "parameters": [{"name": "patience", "type": "ordinal", "values": [1, 2, 3]}]}
    )

    assert baseline_configurations("snail", space) == {"quick": {"patience": 1}}


def test_a_front_with_a_wrong_parameter_of_it_is_refused(pack: Path) -> None:
    document = front_document(pack) | {"application": "snail"}

    with pytest.raises(front_file.InvalidFrontError, match="not a parameter; patience is"):
        front_file.check(document)
    assert not front_file.needs_colour("snail")
    assert not plans.has_plans("snail")
