"""What the user expects of parameters guides a search at first, and less and less."""

import numpy as np
import pytest

from pareto import Explorer, Scenario, Space
from pareto.errors import SpaceError
from pareto.search.models import Models
from pareto.search.targets import Targets
from pareto.search.trend import Trend
from pareto.spaces.hypermapper import write_hypermapper
from pareto.spaces.sampling import first_design
from pareto.spaces.user_prior import LEAST
from tests.builders import spaces
from tests.builders.spaces import parameter
from tests.pareto.searches import spend


def space_of(prior):
    return spaces.space_of(x=parameter(range(100), default=50, **prior), y=range(100))


LOW = space_of({"prior": {"mean": 10, "deviation": 4}})


def x_of(space, indices):
    return np.array([space.decode(int(index))["x"] for index in indices])


def test_the_weights_are_those_of_the_named_shapes_lists_and_normals():
    def weights(prior):
        space = spaces.space_of(x=parameter([1, 2, 4], default=2, prior=prior))
        assert Space.from_dict(space.to_dict()) == space
        return space.weights(np.arange(3)).tolist()

    assert weights([1, 0, 2]) == [0.5, LEAST, 1]
    assert weights({"mean": 2, "deviation": 2}) == pytest.approx([np.exp(-1 / 8), 1, np.exp(-1 / 2)])
    assert weights("gaussian") == pytest.approx([(5 / 9) ** 2, 1, (5 / 9) ** 2])
    low, middle, high = weights("decay")
    assert low > middle > high
    assert weights("exponential") == pytest.approx([high, middle, low])


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        (parameter([1, 2], prior=[1]), "1 weights for 2 values"),
        (parameter([1, 2], prior=[0, 0]), "weight for each value"),
        (parameter([1, 2], prior=[1, -1]), "weight for each value"),
        (parameter([1, 2], prior="bell"), "gaussian, decay, exponential"),
        (parameter([1, 2], prior={"mean": 1}), "deviation above 0"),
        (parameter([1, 2], prior={"mean": 1, "deviation": 0}), "deviation above 0"),
        ({"type": "ordinal", "values": ["a", "b"], "prior": {"mean": 1, "deviation": 1}}, "are numbers"),
        ({"type": "categorical", "values": ["a", "b"], "prior": "decay"}, "give a list of weights"),
        ({"type": "real", "minimum": 0, "maximum": 1, "prior": [1, 2]}, "2 weights for no listed values"),
    ],
)
def test_a_prior_that_does_not_fit_says_what_would(parameter, message):
    with pytest.raises(SpaceError, match=message):
        spaces.space_of(a=parameter)


def test_half_of_the_first_design_follows_the_prior():
    x = x_of(LOW, first_design(LOW, 40, np.random.default_rng(0), set()))
    assert len(x) == 40
    assert 18 <= (x < 22).sum() - (x < 22)[1::2].sum() <= 20
    assert x[1::2].max() > 90  # every second one is spread evenly


def test_the_weight_of_a_prior_falls_with_the_measurements():
    explorer = Explorer(LOW, ["cost"])
    trust = []
    for phase in ("random", "told", "told"):
        points = [{"x": x, "y": len(trust)} for x in range(0, 100, 10)]
        explorer.tell(points, [{"cost": 1.0 + point["x"]} for point in points], phase)
        targets = Targets.of(explorer.history)
        models = Models(explorer.history, targets, Trend.of(None, targets), 100, np.random.default_rng(0))
        trust.append(np.log(models.expected(np.array([0])))[0] / np.log(LOW.weights(np.array([0])))[0])
    assert trust == pytest.approx([10, 10 / 11, 10 / 21])


@pytest.mark.slow
def test_a_right_prior_helps_and_a_wrong_one_is_overcome():
    def cost(point):
        return {"cost": 1 + abs(point["x"] - 12) ** 0.5 + 0.1 * abs(point["y"] - 3)}

    def best(space):
        explorer = Explorer(space, ["cost"], seed=1)
        found = []
        for _ in range(12):
            spend(explorer, 5, measure=cost)
            found.append(explorer.front()[0][1]["cost"])
        return found

    right, none, wrong = (
        best(space_of(prior))
        for prior in ({"prior": {"mean": 12, "deviation": 3}}, {}, {"prior": {"mean": 88, "deviation": 3}})
    )
    assert sum(right) < sum(none)
    assert wrong[-1] < 1.5


def test_hypermapper_s_priors_are_read_and_written():
    inputs = {
        "a": {"parameter_type": "ordinal", "values": [4, 1, 2], "prior": [0.5, 0.3, 0.2]},
        "b": {"parameter_type": "real", "values": [0, 8], "prior": "exponential"},
        "c": {"parameter_type": "real", "values": [0, 8], "prior": "custom_gaussian"},
        "d": {"parameter_type": "categorical", "values": ["u", "v"], "prior": [1, 3]},
        "e": {"parameter_type": "integer", "values": [0, 8], "prior": "uniform"},
    }
    scenario = Scenario.from_dict(
        {
            "optimization_objectives": ["cost"],
            "input_parameters": inputs,
            "custom_gaussian_prior_means": [2],
            "custom_gaussian_prior_stds": [0.5],
        }
    )
    assert scenario.notes == ()
    priors = {item["name"]: item.get("prior") for item in scenario.space.to_dict()["parameters"]}
    assert priors == {
        "a": [0.3, 0.2, 0.5],
        "b": "exponential",
        "c": {"mean": 2, "deviation": 0.5},
        "d": [1, 3],
        "e": None,
    }
    written, _ = write_hypermapper(scenario.space, scenario.objectives)
    assert Scenario.from_dict(written).space == scenario.space
