"""pandas DataFrames in and out of an explorer."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from pareto import Explorer, Objective
from pareto.errors import ConfigurationError, ObjectiveError
from tests.builders.spaces import parameter, space_of

SPACE = space_of(
    algorithm=["plain", "blocked"],
    block=parameter([8, 16], condition="algorithm == 'blocked'"),
    pad=bool,
    scale={"type": "real", "values": [0.5, 1.5]},
)
FRAME = pd.DataFrame(
    {
        "note": ["a", "b", "c", "d"],
        "algorithm": ["plain", "blocked", "blocked", "blocked"],
        "block": [np.nan, 8, 16, 16],  # a float column, as a missing number makes it
        "pad": [True, False, True, True],
        "scale": [0.5, 1.5, 0.5, 0.5],
        "error": [3, 2, 1, 3],
        "seconds": [1.0, 2.0, np.nan, 5.0],
    }
)


def explorer():
    return Explorer(SPACE, ["error", Objective("seconds")], method="random")


def test_tell_frame_does_the_same_as_tell_with_lists():
    from_frame, from_lists = explorer(), explorer()
    from_frame.tell_frame(FRAME)
    plain = {"algorithm": "plain", "block": None, "pad": True, "scale": 0.5}
    blocked = {"algorithm": "blocked", "block": 8, "pad": False, "scale": 1.5}
    padded = {"algorithm": "blocked", "block": 16, "pad": True, "scale": 0.5}
    from_lists.tell(
        [plain, blocked, padded, padded],
        [{"error": 3, "seconds": 1}, {"error": 2, "seconds": 2}, None, {"error": 3, "seconds": 5}],
    )
    assert from_frame.state() == from_lists.state()


def test_frames_of_the_front_and_of_the_evaluations_can_be_read_again():
    first = explorer()
    first.tell_frame(FRAME)
    front = first.front_frame()
    assert list(front.columns) == ["algorithm", "block", "pad", "scale", "error", "seconds"]
    assert front["algorithm"].tolist() == ["blocked", "plain"]
    assert front["block"].tolist() == [8, pd.NA]
    assert front["seconds"].tolist() == [2.0, 1.0]
    every = first.evaluations_frame()
    assert every["seconds"].isna().tolist() == [False, False, True, False]
    assert (every["block"].dtype, every["scale"].dtype, every["pad"].dtype) == ("Int64", "float64", "bool")
    again = explorer()
    again.tell_frame(every)
    assert again.history.results == first.history.results
    assert again.front() == first.front()


def test_an_explorer_that_knows_nothing_has_empty_frames():
    for frame in (explorer().front_frame(), explorer().evaluations_frame()):
        assert frame.shape == (0, 6)


@pytest.mark.parametrize(
    ("frame", "error", "message"),
    [
        (FRAME.drop(columns="pad"), ObjectiveError, "no column 'pad'"),
        (FRAME.rename(columns={"note": "error"}), ObjectiveError, "more than one column 'error'"),
        (FRAME.assign(block=[8, np.nan, 16, 16]), ConfigurationError, "'block' is missing"),
        (FRAME.assign(scale=7.0), ConfigurationError, "scale"),
        (FRAME.assign(error=["1", "2", "3", "4"]), ObjectiveError, "error = '1' is not a finite number"),
        (FRAME.to_dict(), ObjectiveError, "takes a pandas DataFrame, not dict"),
    ],
)
def test_a_frame_that_does_not_fit_changes_nothing(frame, error, message):
    found = explorer()
    with pytest.raises(error, match=message):
        found.tell_frame(frame)
    assert not found.history.results


def test_pandas_is_loaded_only_for_frames():
    code = (
        "import sys; from pareto import Explorer; import pareto.cli.commands; print('pandas' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout == "False\n"
