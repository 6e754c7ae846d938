"""The filters of every page and of the API: what a query string means, and how it is said."""

from datetime import date

import pytest
from django.http import QueryDict
from hypothesis import given
from hypothesis import strategies as st

from crowd.devices.naming.chips import VENDORS
from crowd.results.reading.queries.filters import ALL, InvalidFilterError, SpeedupFilters

TEXTS = st.text(min_size=1, max_size=20).map(str.strip).filter(bool)
WORDS = st.text(min_size=1, max_size=15).map(str.strip).filter(bool)  # eight at most
DAYS = st.dates()
FILTERS = st.builds(
    SpeedupFilters,
    front=st.just("") | TEXTS,
    configuration=st.sampled_from(["best", "accurate", ALL]),
    device=st.just("") | WORDS,
    vendor=st.sampled_from(["", *VENDORS]),
    gpu=st.just("") | TEXTS,
    os=st.sampled_from(["", "Android"]),
    since=st.none() | DAYS,
    min_sessions=st.integers(1, 1_000_000),
    suspect=st.booleans(),
    simulated=st.none() | st.booleans(),
)


def parsed(query: str) -> SpeedupFilters:
    return SpeedupFilters.parse(QueryDict(query))


@given(FILTERS)
def test_a_query_string_means_the_filters_it_was_made_of(filters: SpeedupFilters) -> None:
    assert parsed(filters.query()) == filters


def test_only_what_differs_from_the_default_is_in_the_address_always_in_one_order() -> None:
    given = parsed("min_sessions=3&since=2026-10-01&vendor=qualcomm&suspect=0&os=&backend=+")

    assert given.query() == "vendor=Adreno&since=2026-10-01&min_sessions=3&suspect=0"
    assert SpeedupFilters().query() == ""


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("", ""),
        ("vendor=adreno&os=Android&since=2026-10-01", "Qualcomm Adreno, system “Android”, since 2026-10-01"),
        ("since=2026-10-01&until=2026-10-31", "2026-10-01 to 2026-10-31"),
        ('soc="Tensor"&gpu=""', "SoC “Tensor”, GPU unknown"),
        (
            "simulated=1&until=2026-10-31&min_sessions=3&suspect=0&configuration=all",
            "simulated devices, every configuration, until 2026-10-31, at least 3 sessions, "
            "without suspect figures",
        ),
    ],
)
def test_filters_are_said_in_words(query: str, words: str) -> None:
    assert parsed(query).describe() == words


@pytest.mark.parametrize("word", ["Arm", "arm mali", "Mali", "MALI"])
def test_a_vendor_is_known_by_the_makers_name_and_the_familys(word: str) -> None:
    assert parsed(f"vendor={word}").vendor == "Mali"


@pytest.mark.parametrize(
    ("query", "name"),
    [
        ("vendor=none", "vendor"),
        ("until=soon", "until"),
        ("since=2026-10-02&until=2026-10-01", "until"),
        ("suspect=maybe", "suspect"),
        ("simulated=2", "simulated"),
        (f"soc={'a' * 201}", "soc"),
        (f"backend={'a' * 201}", "backend"),
        (f"device={'a' * 201}", "device"),
        ("device=1+2+3+4+5+6+7+8+9", "device"),
    ],
)
def test_a_filter_that_cannot_be_understood_is_named(query: str, name: str) -> None:
    with pytest.raises(InvalidFilterError, match=name) as raised:
        parsed(query)
    assert raised.value.name == name


def test_the_longest_text_and_as_many_words_as_may_be_are_taken() -> None:
    assert parsed(f"soc={'a' * 200}").soc == "a" * 200
    assert parsed("device=1+2+3+4+5+6+7+8+8+8").device == "1 2 3 4 5 6 7 8 8 8"


def test_a_period_has_a_beginning_or_an_end() -> None:
    assert parsed("since=2026-10-01").since == date(2026, 10, 1)
    assert [parsed(query).period for query in ("", "since=2026-10-01", "until=2026-10-01")] == [
        False, True, True,
    ]  # fmt: skip
