"""Reals without listed values: any number stands for the nearest of many levels."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto import Scenario, Space
from pareto.cli.commands import main
from pareto.errors import ConfigurationError, ScenarioError, SpaceError
from pareto.spaces.configspace import read_configspace, write_configspace
from pareto.spaces.grid import LARGEST
from pareto.spaces.hypermapper import write_hypermapper
from pareto.spaces.sampling import sample
from pareto.spaces.value_ranges import Levels
from tests.builders.spaces import described, parameter, space_of
from tests.pareto.conftest import explore

MU = parameter((0.001, 10), scale="log", default=0.1)
SHARE = parameter((-1, 3), default=1)
SPACE = space_of("mu <= share", mu=MU, share=SHARE)


SCALES = st.sampled_from(["linear", "log"])


@given(st.floats(1e-9, 1e9), st.floats(1e-6, 1e9), SCALES, st.integers(0, 2**16 - 1))
def test_levels_ascend_and_each_is_its_own_nearest(low, width, scale, position):
    levels = Levels(low, low + max(width, 1e-6 * low), scale)
    assert levels.position(levels[position]) == position
    assert (levels[0], levels[-1]) == (levels.minimum, levels.maximum)
    assert levels[max(position - 1, 0)] <= levels[position] <= levels.maximum


def test_a_space_keeps_bounds_and_no_list():
    written = SPACE.to_dict()["parameters"]
    assert written[1] == {**SHARE, "name": "share", "default": pytest.approx(1, abs=1e-4)}
    assert written[0]["default"] == pytest.approx(0.1, rel=1e-4)
    assert Space.from_dict(SPACE.to_dict()) == SPACE
    assert len(SPACE) == 2**32


def test_a_number_becomes_the_nearest_level_and_keeps_its_digits():
    index = SPACE.encode({"mu": 0.0333333333, "share": 0.5})
    found = SPACE.decode(index)
    assert found == pytest.approx({"mu": 0.0333333333, "share": 0.5}, rel=2e-4)
    assert max(map(len, map(str, found.values()))) < 12
    assert SPACE.encode(found) == index
    assert SPACE.parse({"mu": "0.0333333333", "share": " 5e-1"}) == found
    for wrong in (3.5, "a", True, None, float("nan")):
        with pytest.raises(ConfigurationError, match=r"'share': .* -1 \.\. 3"):
            SPACE.encode({"mu": 0.01, "share": wrong})


def test_neighbours_are_near_and_far_on_the_scale():
    space = space_of(mu=MU)
    index = space.encode({"mu": 0.1})
    steps = np.abs(space.neighbours(index) - index)
    assert sorted({*steps.tolist()}) == [2**power for power in range(16)]
    assert space.neighbours(index, reach=1).tolist() == [index - 1, index + 1]
    middle = space.features([space.encode({"mu": 0.1})])
    assert middle == pytest.approx(0.5, abs=1e-5)  # the geometric mean of the bounds


def test_constraints_between_them_are_kept():
    drawn = sample(SPACE, 200, np.random.default_rng(0))
    points = [SPACE.decode(int(index)) for index in drawn]
    assert len(points) == 200
    assert all(point["mu"] <= point["share"] for point in points)
    assert len({point["mu"] for point in points}) > 190


def test_many_of_them_share_the_indices_there_are():
    space = space_of(**{f"x{number}": SHARE for number in range(8)})
    assert LARGEST / 2**8 < len(space) <= LARGEST
    assert Space.from_dict(space.to_dict()) == space
    index = space.encode(dict.fromkeys(space.names, 0.3))
    assert space.encode(space.decode(index)) == index
    with pytest.raises(SpaceError, match="too many"):
        space_of(**{f"x{number}": SHARE for number in range(11)})


def test_hypermapper_and_configspace_keep_them():
    space = Space([SPACE.parameters[0], SPACE.parameters[1]], "s")
    scenario, notes = write_hypermapper(space, Scenario.from_dict(TOY).objectives)
    assert Scenario.from_dict(scenario).space == space
    assert notes == []
    assert read_configspace(write_configspace(space)).space == space
    with pytest.raises(ScenarioError, match=r"'mu', .*: give it a count"):
        write_configspace(SPACE)


TOY = {
    "optimization_objectives": ["cost"],
    "input_parameters": {"x": {"parameter_type": "real", "values": [0, 8], "parameter_default": 3.9}},
}


def test_a_scenario_s_reals_take_any_value_unless_levels_count_them(tmp_path, capsys):
    assert Scenario.from_dict(TOY).space.default["x"] == pytest.approx(3.9, abs=1e-4)
    (tmp_path / "toy.json").write_text(json.dumps(TOY))
    assert main(["space", str(tmp_path / "toy.json")]) == 0
    assert "any value of 0.0 .. 8.0" in capsys.readouterr().out
    assert main(["space", str(tmp_path / "toy.json"), "--levels", "5"]) == 0
    assert "0.0, 2.0, 4.0, 6.0, 8.0" in capsys.readouterr().out


def test_a_table_cannot_answer_for_any_value(toy, capsys):
    (toy / "space.json").write_text(json.dumps(described(x=(1, 20))))
    assert explore(toy, "--budget", "3") == 2
    assert "few of the values that 'x' may take" in capsys.readouterr().err
