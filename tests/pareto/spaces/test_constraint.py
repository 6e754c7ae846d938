"""Constraints: what their expressions mean, and what is refused with which advice."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto.errors import ConstraintError
from pareto.spaces.constraint import Constraint
from tests.builders.spaces import space_of

SPACE = space_of(
    width=[16, 32, 64],
    height=[1, 2, 4, 48],
    tiling=["none", "rows", "blocks"],
    fast=bool,
    cache=[1, "auto", True],
    mu={"type": "real", "values": [0.1 * step for step in range(11)]},
    **{"lanes/warp": range(4)},
)


def kept(text: str) -> set[str]:
    """Return the configurations that keep `text`, reduced to the parameters it names."""
    constraint = Constraint(text, SPACE.parameters)
    values = [parameter.values for parameter in SPACE.parameters if parameter.name in constraint.names]
    grid = np.meshgrid(*(np.arange(len(choices)) for choices in values), indexing="ij")
    columns = dict(zip(constraint.names, grid, strict=True))
    mask = np.ones(grid[0].shape, dtype=bool)
    for clause in constraint.clauses:
        mask &= clause.holds(columns)
    return {
        json.dumps([choices[code] for choices, code in zip(values, codes, strict=True)])
        for codes in np.argwhere(mask)
    }


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("height in [2, 48]", {"[2]", "[48]"}),
        ("height not in (1, 2, 4)", {"[48]"}),
        ("1 < height <= 4", {"[2]", "[4]"}),
        ("width * height == 64", {"[16, 4]", "[32, 2]", "[64, 1]"}),
        ("height ** 2 // 3 - 1 == 0 or height % 5 == 3", {"[2]", "[48]"}),
        ("max(width, height, 3) == 48", {"[16, 48]", "[32, 48]"}),
        (
            "abs(height - 3) <= min(1, width)",
            {"[16, 2]", "[16, 4]", "[32, 2]", "[32, 4]", "[64, 2]", "[64, 4]"},
        ),
        ("tiling == 'none'", {'["none"]'}),
        ("tiling != \"none\" and tiling in ['none', 'rows']", {'["rows"]'}),
        ("not fast", {"[false]"}),
        ("fast == true", {"[true]"}),
        ("fast == False", {"[false]"}),
        ("fast + fast * 2 >= 3", {"[true]"}),
        ("~fast & (height > 4)", {"[48, false]"}),
        ("cache == 1", {"[1]"}),
        ("cache == true or cache == 'auto'", {"[true]", '["auto"]'}),
        ("`lanes/warp` >= 2", {"[2]", "[3]"}),
        ("tiling == 'rows' and 'none' != tiling", {'["rows"]'}),
        ("-height < -4", {"[48]"}),
    ],
)
def test_an_expression_means_what_it_says(text, expected):
    assert kept(text) == expected


def test_numbers_that_differ_by_rounding_only_are_equal():
    assert kept("mu == 0.3") == {json.dumps([0.1 * 3])}
    assert 0.1 * 3 > 0.3
    assert len(kept("mu <= 0.3")) == len(kept("mu < 0.4")) == 4
    assert len(kept("mu != 0.3")) == 10
    assert kept("height * 10 ** 9 == 10 ** 9 + 1") == set()


def test_no_comparison_with_a_division_by_zero_holds():
    undefined = {"[0]"}
    for text in ("6 / `lanes/warp` > 0", "6 // `lanes/warp` != 99", "6 % `lanes/warp` >= 0"):
        assert kept(text).isdisjoint(undefined)
        assert len(kept(text)) == 3
    assert kept("`lanes/warp` == 0 or 6 / `lanes/warp` == 3") == {"[0]", "[2]"}


NAMES = ("width", "height")
LEAF = st.sampled_from(NAMES) | st.integers(0, 70).map(str)
NUMBER = st.recursive(
    LEAF,
    lambda inner: st.one_of(
        st.builds("({} {} {})".format, inner, st.sampled_from(["+", "-", "*", "//", "%", "/"]), inner),
        st.builds("{}({}, {})".format, st.sampled_from(["min", "max"]), inner, inner),
        st.builds("-{}".format, inner),
    ),
    max_leaves=5,
)
COMPARISON = st.one_of(
    st.builds("{} {} {}".format, NUMBER, st.sampled_from(["<", "<=", "==", "!=", ">", ">="]), NUMBER),
    st.builds("{} <= {} < {}".format, NUMBER, NUMBER, NUMBER),
    st.builds("{} in [{}, {}]".format, NUMBER, NUMBER, NUMBER),
)
CONDITION = st.recursive(
    COMPARISON,
    lambda inner: st.one_of(
        st.builds("({} {} {})".format, inner, st.sampled_from(["and", "or"]), inner),
        st.builds("not {}".format, inner),
    ),
    max_leaves=4,
)


@pytest.mark.slow
@settings(deadline=None, max_examples=100)
@given(CONDITION)
def test_arithmetic_and_logic_are_pythons(text):
    """Wherever Python itself can evaluate the expression, it and we agree."""
    text = f"(width + height > 0) == ({text})"  # both parameters are named, and all is one clause
    try:
        expected = {
            json.dumps([width, height])
            for width in SPACE.parameters[0].values
            for height in SPACE.parameters[1].values
            if eval(text, {"__builtins__": {}, "min": min, "max": max}, {"width": width, "height": height})
        }
    except ZeroDivisionError:
        return
    assert kept(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("widht > 2", "unknown parameter 'widht': did you mean 'width'"),
        ("tiling == none", "unknown parameter 'none'.*texts are written in quotes"),
        ("`lanes` > 2", "unknown parameter 'lanes'"),
        ("width *", "write a condition such as"),
        ("width", "'width' is a number, not a condition: compare it"),
        ("width == 16 or 32", "'32' is a number, not a condition"),
        ("width & height", "'width' is a number, not a condition"),
        ("tiling", "'tiling' is a text, not a condition"),
        ("tiling < 'rows'", "texts have no order"),
        ("tiling == 'row'", "'tiling' is never 'row': it is one of"),
        ("tiling in ['rows', 3]", "'tiling' is never 3"),
        ("cache == 'none'", "'cache' is never 'none'"),
        ("tiling == width", "'width' is a number, 'tiling' a text"),
        ("tiling + 'a' == 'rowsa'", "'tiling' is a text: .* needs numbers"),
        ("min(width) > 1", "'min.width.' is not understood"),
        ("width in height", "'height' is not a list: write width in"),
        ("width in []", "is not a list"),
        ("width is 16", "write == or !="),
        ("1 < 2", "depends on no parameter"),
        ("width > 1 and 1 < 2", "'1 < 2' depends on no parameter"),
        ("width > None", "None is neither a number"),
        ("width > 1j", "1j is neither a number"),
        ("width > 1e999", "is neither a number"),
        ("width > 1" + 400 * "0", "is neither a number"),
        ("width > 1\0", "null bytes"),
        ("-" * 900 + "width > 0", "nested|cannot be read"),
        ("not " * 150 + "fast", "nested deeper than 100"),
        ("(" * 300 + "fast" + ")" * 300, "parentheses|cannot be read"),
        (" + ".join(["width"] * 120) + " > 0", "nested deeper than 100"),
        ("x" * 1001, "1 to 1000 characters"),
        ("  ", "1 to 1000 characters"),
        (5, "1 to 1000 characters, not 5"),
    ],
)
def test_what_is_no_condition_is_refused_with_advice(text, message):
    with pytest.raises(ConstraintError, match=message):
        Constraint(text, SPACE.parameters)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true') == 0",
        "width.__class__ == 1",
        "[x for x in [1]] == 1",
        "(lambda: 1)() == 1",
        "eval('1') == 1",
        "f'{width}' == 'a'",
        "width if fast else height",
        "(width := 3) > 1",
        "{'a': 1}['a'] == width",
        "max(width, *[1]) > 1",
        "max(width, 1, key=abs) > 1",
        "width @ height > 1",
        "width << 2 > 1",
        "height > ...",
        "height == b'a'",
    ],
)
def test_nothing_but_the_small_language_is_run(text):
    with pytest.raises(ConstraintError, match=r"is not understood|is neither a number|write a condition"):
        Constraint(text, SPACE.parameters)


WORDS = "width fast tiling 'rows' 1 0.5 + * / // % ** < == and or not in & | ~ is lambda = :"
MARKS = "( ) [ ] , min( abs( ` ' . * \\"
TOKENS = st.sampled_from([*WORDS.split(), *MARKS.split(), "\n"])


@settings(deadline=None, max_examples=300)
@given(st.lists(TOKENS, min_size=1, max_size=9).map(" ".join))
def test_every_text_is_a_condition_whose_negation_holds_elsewhere_or_is_refused(text):
    try:
        constraint = Constraint(text, SPACE.parameters)
    except ConstraintError:
        return
    values = [parameter.values for parameter in SPACE.parameters if parameter.name in constraint.names]
    assert len(kept(text)) + len(kept(f"not ({text})")) == math.prod(map(len, values))


def test_the_longest_expressions_are_evaluated():
    deep = "not " * 90 + "fast"
    assert kept(deep) == {"[true]"}
    wide = " + ".join(["height"] * 90) + " == 90"
    assert kept(wide) == {"[1]"}


def test_a_name_beyond_ascii_is_found_as_python_reads_it():
    name = "\N{MICRO SIGN}"
    space = space_of(f"{name} < 3", f"`{name}` != 2", **{name: [1, 2, 3]})
    assert space.allowed(range(3)).tolist() == [True, False, False]


def test_conditions_joined_by_and_are_clauses_of_their_own():
    constraint = Constraint("fast and 1 <= height < width and (mu > 0 or fast)", SPACE.parameters)
    assert [clause.names for clause in constraint.clauses] == [
        ("fast",),
        ("height",),
        ("height", "width"),
        ("mu", "fast"),
    ]
    assert constraint.names == ("width", "height", "fast", "mu")
