"""The bars of the crowd as the server draws them, read back from the SVG."""

import re
from html import unescape
from xml.etree import ElementTree

import pytest
from msgspec import structs

from crowd.dashboard.figures.bar_picture import FLAT, MOST_BARS, NAMED, BarPicture, bar_picture
from crowd.dashboard.figures.speedups import SOC, VENDOR
from crowd.dashboard.formats import TIMES
from crowd.records.speedup import Speedup
from tests.builders.rows import device, speedup


def crowd(count: int) -> list[Speedup]:
    """So many models, from 14 times down to 2 times."""
    return [speedup(14 - 12 * number / count, f"model-{number}") for number in range(count)]


def texts(picture: BarPicture) -> list[str]:
    """What is written in `picture`, which is well formed."""
    ElementTree.fromstring(picture.svg)
    found = re.findall(r"<text[^>]*>(.*?)</text>", picture.svg, re.DOTALL)
    plain = [" ".join(unescape(re.sub(r"<[^>]+>", "", text)).split()) for text in found]
    return [text.replace(TIMES, "x") for text in plain]


def bars(picture: BarPicture) -> list[str]:
    return re.findall(r'<rect class="(?:family|series)[^>]*>', picture.svg)


@pytest.mark.parametrize("count", [0, 1, FLAT, FLAT + 1, NAMED, NAMED + 1])
def test_the_picture_is_well_formed_with_a_bar_a_figure(count: int) -> None:
    picture = bar_picture(crowd(count), 5.0 if count else None, VENDOR)

    ElementTree.fromstring(picture.svg)
    assert len(bars(picture)) == count
    assert not picture.note


def test_few_bars_have_their_whole_name_and_chip() -> None:
    row = speedup(8.0, device=device(name="Redmi Note 12 Pro 5G Speed Edition Plus"), processor="Adreno 619")

    picture = bar_picture([row, speedup(2.0, "other")], None, VENDOR)

    assert "8.00x Redmi Note 12 Pro 5G Speed Edition Plus" in texts(picture)
    assert "Adreno 619" in texts(picture)


def test_of_many_the_largest_the_smallest_and_the_mean_are_written() -> None:
    picture = bar_picture(crowd(40), 5.391, VENDOR)

    written = texts(picture)
    assert "mean 5.39x" in written
    assert "largest 14.0x Model-0" in written
    assert "smallest 2.30x Model-39" in written
    assert "Model-20" in written
    # Where more are there than fit, only the extremes are named.
    assert "Model-20" not in texts(bar_picture(crowd(NAMED + 1), 5.0, VENDOR))


def test_an_interval_stays_below_the_top_of_the_axis_and_under_the_label() -> None:
    rows = crowd(20)
    rows[3] = structs.replace(rows[3], low=4.0, high=15.9)

    picture = bar_picture(rows, 5.0, VENDOR)

    ends = [float(y) for y in re.findall(r'class="whisker" [^>]*y2="([\d.]+)"', picture.svg)]
    label = float(re.findall(r'class="label" x="0" y="([\d.]+)"', picture.svg)[0])
    axis = [float(y) for y in re.findall(r'class="grid" [^>]*y2="([\d.]+)"', picture.svg)]
    assert min(axis) < min(ends)
    assert label < min(ends)


def test_of_a_large_crowd_a_selection_is_drawn_and_the_picture_says_so() -> None:
    picture = bar_picture(crowd(3 * MOST_BARS), 5.0, VENDOR)

    assert len(bars(picture)) == MOST_BARS
    assert picture.note == "400 of 1,200 points drawn"
    assert len(picture.svg) < 150_000


def test_what_does_not_count_stands_last_and_does_not_flatten_the_others() -> None:
    rows = [speedup(40.0, "invented", confirmed=False), speedup(39.0, "hot", suspect=True), *crowd(20)]

    picture = bar_picture(rows, 5.0, VENDOR)

    alone = bar_picture(crowd(20), 5.0, VENDOR)
    heights = [re.findall(r'y="([\d.]+)"', bar)[0] for bar in bars(picture)]
    assert heights[:20] == [re.findall(r'y="([\d.]+)"', bar)[0] for bar in bars(alone)]
    assert [" hollow" in bar for bar in bars(picture)] == [False] * 20 + [True, False]
    assert picture.svg.count("url(#stripes)") == 1
    assert "largest 14.0x Model-0" in texts(picture)


def test_colours_are_explained_where_there_are_several() -> None:
    rows = [
        speedup(3.0, "a", device=device("a", soc="Tensor G3"), processor="Mali-G715"),
        speedup(2.0, "b", device=device("b", soc="Exynos 2100"), processor="Adreno 740"),
    ]

    assert bar_picture(rows, None, VENDOR).groups == (("Adreno", "family-adreno"), ("Mali", "family-mali"))
    assert bar_picture(rows, None, SOC).groups == (("Exynos 2100", "series-1"), ("Tensor G3", "series-2"))
    assert bar_picture(rows[:1], None, VENDOR).groups == ()
    assert bar_picture([*rows, speedup(1.5, "pc")], None, SOC).groups[-1] == ("PC or unknown", "family-cpu")


def test_names_of_devices_are_text_and_never_markup() -> None:
    assert "2.00x <b>&" in texts(bar_picture([speedup(2.0, device=device(name="<b>&"))], None, VENDOR))
