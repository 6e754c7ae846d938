"""What the pictures of an exploration show."""

import numpy as np
import pytest

from pareto import Explorer, Objective, Space
from pareto.cli.commands import main
from pareto.plot import save
from pareto.plot.arrivals import Arrivals
from pareto.plot.growth import front_over_time, hypervolume_over_evaluations
from pareto.plot.models import grown, importances, parameter_importance, predicted_against_measured
from pareto.plot.parameters import parallel_coordinates, slices
from pareto.plot.scatter import scatter
from pareto.surrogates.prediction import out_of_bag
from tests.builders.spaces import described, parameter, space_of
from tests.pareto.conftest import complaint, explore

SPACE = Space.from_dict({"name": "a <b> & c"} | described(**{"x<1>": range(1, 41), "y": range(1, 301)}))


OBJECTIVES = ["cost", "error", "quality"]


def explored(count=60, objectives=("cost", "error"), limits=None, space=SPACE, seed=0):
    """An exploration by chance, then by Algorithm 1's name; every tenth measurement failed."""
    explorer = Explorer(space, objectives, limits, method="random", seed=seed)
    for number, proposal in enumerate(explorer.propose(count)):
        x, y = proposal.configuration.values()
        values = {"cost": x * (1 + y / 1000), "error": 3 / x, "quality": float(x)}
        if number >= count // 2:
            explorer.history.withdraw(proposal.index)
            explorer.history.expect(proposal.index, "active")
        explorer.tell([proposal.configuration], [None if number % 10 == 9 else values])
    return explorer


def traces(figure):
    return {trace.name.split(" (")[0]: trace for trace in figure.data if trace.name}


def test_random_samples_are_red_active_ones_black_and_the_front_lies_below_them():
    explorer = explored(limits={"error": 1.0})
    drawn = traces(figure := scatter(Arrivals.of(explorer)))
    assert drawn["random samples"].marker.color == "#d62728"
    assert drawn["active learning"].marker.color == "#222222"
    assert len(drawn["random samples"].x) + len(drawn["active learning"].x) == 54
    front = explorer.front()
    assert list(drawn["front"].x) == [values["cost"] for _, values in front]
    assert max(drawn["front"].y) <= 1.0
    assert figure.layout.annotations[0].text == "error at most 1"
    assert "x&lt;1&gt; " in drawn["front"].text[0]


def test_the_default_is_marked_where_it_was_measured():
    explorer = explored()
    assert "default" not in traces(scatter(Arrivals.of(explorer)))
    explorer.tell([SPACE.default], [{"cost": 1.0, "error": 3.0}])
    assert list(traces(scatter(Arrivals.of(explorer)))["default"].x) == [1.0]


def test_stairs_turn_where_nothing_is_gained():
    # Minimised cost: between two points the dearer one's quality is not yet to be had.
    objectives = ["cost", Objective("quality", maximise=True)]
    shapes = [
        traces(scatter(Arrivals.of(explored(objectives=objectives)), *axes))["front"].line.shape
        for axes in ((0, 1), (1, 0))
    ]
    assert shapes == ["hv", "vh"]


def test_of_very_many_points_a_selection_is_drawn_and_the_whole_front(monkeypatch):
    monkeypatch.setattr("pareto.plot.scatter.MOST_POINTS", 500)
    explorer = explored(count=600)
    drawn = traces(scatter(Arrivals.of(explorer)))
    points = len(drawn["random samples"].x) + len(drawn["active learning"].x)
    assert 250 < points <= 500 < len(explorer.history.measured()[0])
    assert len(drawn["front"].x) == len(explorer.front())


def test_fronts_over_time_are_those_of_their_moments():
    explorer = explored(count=64)
    figure = front_over_time(Arrivals.of(explorer))
    assert [trace.name for trace in figure.data] == [f"after {count}" for count in (4, 8, 16, 32, 64)]
    half = Explorer(SPACE, ["cost", "error"], method="random")
    results = list(explorer.history.results.items())[:16]
    half.tell(
        [SPACE.decode(index) for index, _ in results],
        [values and dict(zip(["cost", "error"], values, strict=True)) for _, (values,) in results],
    )
    assert list(figure.data[2].x) == [values["cost"] for _, values in half.front()]


def test_the_hypervolume_is_red_until_active_learning_begins():
    chance, active = hypervolume_over_evaluations(Arrivals.of(explored(count=64))).data
    assert (chance.line.color, active.line.color) == ("#d62728", "#222222")
    assert list(chance.x) == list(range(1, 33))
    assert list(active.x) == list(range(32, 65))
    assert chance.y[-1] == active.y[0]
    assert (np.diff([*chance.y, *active.y]) >= 0).all()


@pytest.mark.slow
def test_the_most_important_parameter_is_on_top():
    arrivals = Arrivals.of(explored(count=600))
    shares = importances(arrivals, grown(arrivals))
    assert list(shares) == ["cost", "error", "failing"]
    figure = parameter_importance(shares)
    assert list(figure.data[0].y) == ["y", "x&lt;1&gt;"]  # from below
    assert figure.data[0].x[1] > 0.8
    assert max(shares["failing"].values()) < 0.1  # every tenth, whatever the parameters


def test_predictions_are_drawn_against_what_was_measured():
    arrivals = Arrivals.of(explored(count=600))
    prediction = out_of_bag(grown(arrivals)["cost"])
    figure = predicted_against_measured(arrivals, "cost", prediction, {"cost": "s"})
    points = [trace for trace in figure.data if trace.mode == "markers"]
    assert sum(len(trace.x) for trace in points) == len(prediction.rows) == 540
    assert figure.layout.xaxis.title.text == "cost [s], measured (log)"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "objectives"),
    [
        (0, OBJECTIVES),
        (1, ["cost"]),
        (10, ["cost"]),
        (40, OBJECTIVES),
        *(pytest.param(count, ["cost"], marks=pytest.mark.exhaustive) for count in (0, 40)),
        *(pytest.param(count, OBJECTIVES, marks=pytest.mark.exhaustive) for count in (1, 10)),
    ],
)
def test_a_page_of_few_measurements_and_any_number_of_objectives_is_whole(tmp_path, objectives, count):
    save(explored(count, objectives), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Exploration of a &lt;b&gt; &amp; c" in page
    assert page.count("Exploration: ") == (len(objectives) * (len(objectives) - 1) // 2 or 1) * (count > 0)
    assert ("Importance of parameters" in page) == (count == 40)
    assert page.count("<h2>Slices: ") == len(objectives) * (count > 0)
    assert page.count("<h2>Parallel coordinates") == (count > 0)
    assert ("Nothing to draw" in page) == (count == 0)
    assert page.endswith("</html>\n")


@pytest.mark.slow
def test_the_command_draws_a_folder_and_takes_units(toy, capsys):
    explore(toy, "--budget", "10")
    assert main(["plot", str(toy / "out"), "--units", "seconds=s"]) == 0
    assert "seconds [s]" in (toy / "out" / "front.html").read_text()
    assert main(["plot", "--out", str(toy / "out"), "--output", str(toy / "mine.html")]) == 0
    assert (toy / "mine.html").exists()
    capsys.readouterr()
    for arguments, message in [
        ([], "plot what?"),
        ([str(toy / "none")], "holds no exploration"),
        ([str(toy / "out"), "--units", "power=W"], "'power=W'"),
    ]:
        assert main(["plot", *arguments]) == 2
        assert message in complaint(capsys)


MIXED = space_of(
    rate=parameter((0.01, 100), scale="log", default=1),
    kind=["<a>", "b"],
    part=parameter([2, 4, 9], condition="kind == 'b'"),
    fixed=[7],
)


def mixed():
    explorer = Explorer(MIXED, ["cost", Objective("quality", maximise=True)])
    points = [
        {"rate": 0.1, "kind": "<a>", "part": None, "fixed": 7},
        {"rate": 10, "kind": "b", "part": 9, "fixed": 7},
        {"rate": 1, "kind": "b", "part": 2, "fixed": 7},
    ]
    explorer.tell(points, [{"cost": 1, "quality": 1}, {"cost": 50, "quality": 4}, {"cost": 60, "quality": 3}])
    return Arrivals.of(explorer)


def test_a_slice_has_each_measurement_in_which_its_parameter_is_active():
    figure = slices(mixed(), 0, {"cost": "s"})
    rate, kind, part = figure.data
    assert list(rate.x) == pytest.approx([0.1, 10, 1], rel=1e-3)
    assert list(kind.x) == ["&lt;a&gt;", "b", "b"]
    assert (list(part.x), list(part.y)) == ([9, 2], [50, 60])
    assert list(rate.marker.color) == [0, 1, 2]  # in order of arrival
    assert [figure.layout[f"xaxis{number}"].type for number in ("", 2, 3)] == ["log", "category", "linear"]
    assert figure.layout.yaxis.title.text == "cost [s] (log)"


def test_parallel_coordinates_have_every_axis_and_the_front_on_top():
    [drawn] = parallel_coordinates(mixed(), {"cost": "s"}).data
    rate, kind, part, cost, quality = drawn.dimensions
    assert list(drawn.line.color) == [0, 1, 1]
    assert [axis.label for axis in drawn.dimensions] == ["rate", "kind", "part", "cost [s] (log)", "quality"]
    assert list(rate.ticktext) == ["0.01", "0.1", "1", "10", "100"]
    assert list(kind.ticktext) == ["&lt;a&gt;", "b"]
    assert list(part.values) == pytest.approx([0, -0.3, 2])  # the first is not on the front
    assert part.ticktext[0] == "inactive"
    assert list(cost.values) == pytest.approx(np.log10([60, 1, 50]))
    assert list(quality.values) == [3, 1, 4]
