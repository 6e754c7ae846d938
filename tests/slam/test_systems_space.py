"""The space over both systems: one decides which parameters are active, and its defaults are the crowd's."""

from pathlib import Path

import numpy as np
import pytest

import pareto
from pareto import Explorer, Space
from pareto.plot.arrivals import Arrivals
from pareto.plot.scatter import scatter
from pareto.plot.style import SERIES
from pareto.spaces.sampling import sample
from slam.definitions import SYSTEMS, complete
from slam.devices.build import split
from slam.kfusion.configuration import STANDARD

SPACES = Path(pareto.__file__).parent / "spaces"
SPACE = Space.load(SPACES / "systems.json")


def active(configuration):
    """The active parameters of the system."""
    given = {name: value for name, value in configuration.items() if value is not None and name != "system"}
    return split(given)[0]


def test_the_default_is_the_crowds():
    assert SPACE.default["system"] == "kfusion"
    assert active(SPACE.default) == STANDARD.to_dict()


@pytest.mark.parametrize("system", SYSTEMS)
def test_parameters_and_values_are_those_of_the_systems_own_space(system):
    own = Space.load(SPACES / f"{system}.json")
    joined = {item.name: item.values for item in SPACE.parameters}
    assert {item.name: joined[item.name] for item in own.parameters} == {
        item.name: item.values for item in own.parameters
    }


def test_every_sample_is_a_configuration_of_its_system():
    drawn = [SPACE.decode(index) for index in sample(SPACE, 60, np.random.default_rng(0)).tolist()]
    assert {configuration["system"] for configuration in drawn} == set(SYSTEMS)
    for configuration in drawn:
        values = active(configuration)
        assert values.items() <= complete(configuration["system"], values).items()
        assert ("time_window" in values) == (configuration["open_loop"] is False)


def test_one_front_is_coloured_by_system():
    assert SPACE.conditions.choice.name == "system"
    explorer = Explorer(SPACE, ("error", "time"), method="random")
    for number, index in enumerate(sample(SPACE, 30, np.random.default_rng(0)).tolist()):
        configuration = SPACE.decode(index)
        fast = configuration["system"] == "kfusion"
        explorer.tell(
            [configuration], [{"error": (30 - number) * (2 if fast else 1), "time": number + 30 * fast}]
        )
    figure = scatter(Arrivals.of(explorer), by=SPACE.conditions.choice)
    names = [trace.name.split(" (")[0] for trace in figure.data]
    assert names == ["system kfusion", "system elasticfusion", "front"]
    assert sum(len(trace.x) for trace in figure.data[:2]) == 30
    front = figure.data[2]
    expected = [SERIES[0] if point["system"] == "kfusion" else SERIES[1] for point, _ in explorer.front()]
    assert list(front.marker.color) == expected
