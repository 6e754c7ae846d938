from datetime import UTC, datetime

import pytest

from crowd.dashboard import formats
from crowd.dashboard.templatetags.units import interval_of
from tests.builders.rows import speedup


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (9.714, "9.71"),
        (9.999, "10.0"),
        (99.96, "100"),
        (11.36, "11.4"),
        (104.2, "104"),
        (1240.4, "1,240"),
        (0.0270, "0.0270"),
        (-2.5, "\N{MINUS SIGN}2.50"),
        (0.0, "0"),
    ],
)
def test_numbers_have_three_significant_digits(value: float, text: str) -> None:
    assert formats.significant(value) == text


@pytest.mark.parametrize(
    ("shown", "text"),
    [
        (formats.speedup(9.714), f"9.71{formats.TIMES}"),
        (formats.milliseconds(0.01234), f"12.3{formats.GAP}ms"),
        # No time is finer than the microseconds it was measured in.
        (formats.milliseconds(0.000_001), f"0.001{formats.GAP}ms"),
        (formats.milliseconds(0.000_0274), f"0.027{formats.GAP}ms"),
        (formats.milliseconds(0.000_111), f"0.111{formats.GAP}ms"),
        (formats.frames_per_second(0.01), f"100{formats.GAP}fps"),
        (formats.centimetres(0.0447), f"4.47{formats.GAP}cm"),
        (formats.data_size(19_800_000), f"19.8{formats.GAP}MB"),
        (formats.change(1.03), f"+3.0{formats.GAP}%"),
        (formats.change(0.98), f"\N{MINUS SIGN}2.0{formats.GAP}%"),
        # An interval names its unit once.
        (formats.interval(9.5, 11.25), f"9.50{formats.RANGE}11.2{formats.TIMES}"),
        # Parameters read as their authors write them.
        (formats.parameter(1e-5), "1e-05"),
        (formats.parameter(256), "256"),
        (formats.parameter(True), "yes"),
        (formats.parameter(["default", "best"]), "default, best"),
        (formats.parameter({"name": "Mali", "driver": None}), f"name Mali, driver {formats.ABSENT}"),
        # Counts agree with their noun.
        (formats.plural(1, "device"), "1\N{NO-BREAK SPACE}device"),
        (formats.plural(2000, "device"), "2,000\N{NO-BREAK SPACE}devices"),
        (formats.frames(1.0), "1\N{NO-BREAK SPACE}frame"),
        (formats.frames(44.23), "44.2\N{NO-BREAK SPACE}frames"),
        # Public times tell the hour alone.
        (formats.hour(datetime(2026, 11, 20, 10, 47, tzinfo=UTC)), "2026-11-20 10:00 UTC"),
        (formats.configuration("front-03"), "front-03"),
        (formats.configuration("", 1132), "no.\N{NO-BREAK SPACE}1,132"),
        (formats.configuration(""), formats.ABSENT),
    ],
)
def test_units_are_chosen_once_for_every_page(shown: str, text: str) -> None:
    assert shown == text


def test_names_of_points_that_are_numbered_are_known() -> None:
    numbered = [formats.is_numbered(name) for name in ("front-03", "probe-1", "fast3", "best")]
    assert numbered == [True, True, False, False]


def test_what_is_absent_is_never_a_zero() -> None:
    functions = [
        formats.speedup,
        formats.milliseconds,
        formats.frames_per_second,
        formats.centimetres,
        formats.data_size,
        formats.count,
        formats.percent,
        formats.change,
        formats.parameter,
        formats.hour,
        formats.day,
    ]
    assert {function(None) for function in functions} == {formats.ABSENT}
    assert formats.interval(None, 3.0) == formats.ABSENT


def test_the_interval_of_a_figure_says_when_it_is_of_one_session() -> None:
    over_installations = speedup(low=5.0, high=7.0, session_low=5.5, session_high=6.5)
    of_one = speedup(session_low=5.5, session_high=6.5)

    assert interval_of(over_installations) == formats.interval(5.0, 7.0)
    assert interval_of(of_one) == f"{formats.interval(5.5, 6.5)} <small>one session</small>"
    assert interval_of(speedup()) == interval_of(None) == formats.ABSENT
