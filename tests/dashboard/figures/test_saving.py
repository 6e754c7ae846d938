"""Figures as files for a paper's column and a slide: sizes, fonts, and text that overlaps nothing."""

from itertools import pairwise
from typing import Any

import pytest
from django.test import Client
from plotly import graph_objects as go

from crowd.dashboard.figures.elements import layout
from crowd.dashboard.figures.elements.wrapping import text_width, wrapped
from crowd.dashboard.figures.palette import LIGHT
from crowd.dashboard.figures.saving import (
    AROUND_ROWS,
    AXIS_FONT,
    COLUMN,
    EDGE,
    FONT,
    LINE,
    MEDIA,
    SLIDE,
    Medium,
    SavedFigure,
    render_for,
)

ADDRESS = "https://frontrunner.example/devices/?gpu=" + "Adreno+730%2C" * 12 + "&simulated=1"
SOURCE = (ADDRESS, "Drawn on 2026-11-25 from live data", "CC-BY-4.0")


def figure(rows: int = 3, height: int = 400) -> go.Figure:
    """Flat bars with names above them, a legend, a line with words above it and a long axis title."""
    drawn = layout.blank(LIGHT, height)
    drawn.add_bar(y=list(range(rows)), x=[1.0] * rows, orientation="h", name="first", showlegend=True)
    layout.name_bars(drawn, [("9.7\N{MULTIPLICATION SIGN}", f"Phone {row}") for row in range(rows)], LIGHT)
    layout.upright_line(drawn, 5.0, "valid below 5 cm", LIGHT.limit)
    return drawn.update_layout(
        xaxis={"title": {"text": "a long title of an axis, " * 6}, "range": [0, 5.5]},
        yaxis=layout.flat_rows(rows),
        legend={"entrywidth": 58},
    )


def picture(medium: Medium, drawn: go.Figure | None = None) -> SavedFigure:
    return render_for(drawn or figure(), medium, "Speedup by device, " * 8, "n = 81 figures", SOURCE)


@pytest.mark.parametrize("medium", MEDIA.values(), ids=MEDIA)
@pytest.mark.parametrize("rows", [1, 30])
def test_title_figure_and_source_lie_below_each_other_within_the_picture(medium: Medium, rows: int) -> None:
    shown = picture(medium, figure(rows, 96 + 54 * rows))

    above = [line for line in shown.lines if line.y <= shown.top]
    below = [line for line in shown.lines if line.y > shown.top]
    assert [line.weight for line in above].count(700) >= 2
    assert below[0].y - below[0].size >= shown.top + shown.figure.layout.height - 1
    assert all(line.y + line.size / 3 <= shown.height for line in below)
    assert all(
        second.y - first.y >= second.size * 1.2 for part in (above, below) for first, second in pairwise(part)
    )
    for line in shown.lines:
        scale = shown.width / medium.width
        assert line.x + text_width(line.text, line.size) <= shown.width - EDGE * scale / 2, line
    assert shown.figure.layout.width == round(shown.width)


def test_a_slide_of_many_rows_becomes_taller_before_its_text_is_too_small() -> None:
    many = picture(SLIDE, figure(60, 96 + 54 * 60))

    assert many.width / many.height < 16 / 9
    assert many.width <= 1.5 * SLIDE.width
    # A row has the height of its name, which is on the axis; its text is as large as the rows allow.
    assert many.figure.layout.height >= 60 * 13 * 1.3
    fewer = picture(SLIDE, figure(30, 96 + 54 * 30)).figure.layout
    assert fewer.height == pytest.approx(30 * AXIS_FONT * LINE + AROUND_ROWS, abs=1)


def test_nothing_of_the_source_is_lost() -> None:
    for medium in MEDIA.values():
        written = "".join(line.text for line in picture(medium).lines).replace(" ", "")
        assert all(part.replace(" ", "") in written for part in SOURCE), medium.name


def test_a_column_is_85_mm_wide_with_fonts_of_7_to_9_points_at_300_dpi() -> None:
    drawn = figure()
    drawn.update_traces(textfont={"size": 4})
    drawn.update_layout(xaxis={"tickfont": {"size": 30}})
    shown = picture(COLUMN, drawn)
    frame = shown.frame()
    points = 85 / 25.4 * 72 / shown.width

    assert frame["millimetres"][0] == 85
    assert frame["pixels"][0] == round(85 / 25.4 * 300)
    assert frame["pixels"][0] / frame["pixels"][1] == pytest.approx(shown.width / shown.height, rel=2e-3)
    sizes = [line.size for line in shown.lines] + fonts(shown.figure.to_plotly_json())
    assert len(sizes) > 8
    assert all(7 <= size * points <= 9 for size in sizes), [size * points for size in sizes]


def fonts(part: Any) -> list[float]:
    """The sizes of all fonts in `part` of a figure."""
    if isinstance(part, dict):
        own = [value["size"] for name, value in part.items() if name.endswith("font") and "size" in value]
        return own + [size for value in part.values() for size in fonts(value)]
    return [size for value in part for size in fonts(value)] if isinstance(part, list | tuple) else []


def test_a_slide_has_1920_by_1080_pixels() -> None:
    for rows in (1, 12):
        frame = picture(SLIDE, figure(rows, 96 + 54 * rows)).frame()
        assert frame["pixels"] == [1920, 1080]
        assert frame["width"] / frame["height"] == pytest.approx(16 / 9)


def test_a_slide_has_the_names_of_bars_beside_them_and_a_column_above() -> None:
    wide, narrow = picture(SLIDE).figure.layout, picture(COLUMN).figure.layout

    names = [f"<b>9.7\N{MULTIPLICATION SIGN}</b>  Phone {row}" for row in range(3)]
    assert list(wide.yaxis.ticktext) == names
    assert [words.text for words in wide.annotations] == ["valid below 5 cm"]
    assert [words.text for words in narrow.annotations if words.name == layout.ROW_NAME] == names
    assert narrow.yaxis.ticktext is None


@pytest.mark.parametrize("medium", MEDIA.values(), ids=MEDIA)
def test_the_legend_is_below_the_axis_and_words_above_the_plot_stay_inside(medium: Medium) -> None:
    shown = picture(medium).figure.layout

    assert (shown.legend.yref, shown.legend.y, shown.legend.yanchor) == ("container", 0, "bottom")
    (words,) = [words for words in shown.annotations if words.text.startswith("valid")]
    assert words.xanchor == "right"
    assert shown.margin.t > 16
    assert "<br>" in shown.xaxis.title.text


def test_a_column_has_what_a_figure_changes_on_a_phone() -> None:
    drawn = figure().update_layout(meta={"narrow": {"xaxis.ticktext": ["short"], "yaxis.title.text": "t"}})

    narrow, wide = (picture(medium, drawn).figure.layout for medium in (COLUMN, SLIDE))

    assert (list(narrow.xaxis.ticktext), narrow.yaxis.title.text) == (["short"], "t")
    assert (wide.xaxis.ticktext, wide.meta, narrow.meta) == (None, None, None)


def test_a_saved_figure_is_white_in_fonts_that_every_program_has_and_the_drawn_one_stays() -> None:
    drawn = figure()
    before = drawn.to_json()

    shown = picture(COLUMN, drawn).figure.layout

    assert shown.paper_bgcolor == shown.plot_bgcolor == "#ffffff"
    assert shown.font.family == FONT
    assert "system-ui" not in FONT
    assert drawn.to_json() == before


def test_a_word_is_cut_only_where_it_is_longer_than_a_line() -> None:
    assert wrapped("one two three", 10, 60) == ["one two", "three"]
    assert "".join(wrapped("/a" * 40, 10, 100)) == "/a" * 40
    assert max(text_width(line, 10) for line in wrapped("see " + "/a" * 40, 10, 100)) <= 100
    assert wrapped("temperature, °C", 13, 40, cut=False) == ["temperature,", "°C"]


@pytest.mark.django_db
@pytest.mark.usefixtures("session")
@pytest.mark.parametrize("medium", MEDIA)
def test_a_figure_to_save_says_where_it_is_from(client: Client, medium: str) -> None:
    document = client.get(f"/figures/speedups.json?vendor=Mali&theme=dark&save={medium}").json()

    written = " ".join(line["text"] for line in document["saved"]["lines"])
    assert "http://testserver/devices/?vendor=Mali " in written.replace(
        "\N{NO-BREAK SPACE}\N{MIDDLE DOT}", " "
    )
    assert "save=" not in written
    assert "Speedup by device" in written
    assert "n\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}1" in written
    assert "no release of the open data yet" in written
    assert "CC-BY-4.0" in written
    assert document["saved"]["name"] == f"frontrunner-speedups-{medium}"
    assert document["layout"]["paper_bgcolor"] == "#ffffff"
    assert document["layout"]["font"]["color"] == LIGHT.ink
    assert "\N{NARROW NO-BREAK SPACE}" not in str(document)
