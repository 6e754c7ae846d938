"""One palette in two files: the sheet for pages, palette.py for figures."""

import re

import pytest
from django.contrib.staticfiles import finders

from crowd.dashboard.palette import DARK, LIGHT, THEMES, Theme


def properties(theme: Theme) -> dict[str, str]:
    """The custom properties that style.css sets in THEME."""
    path = finders.find("dashboard/style.css")
    assert isinstance(path, str)
    with open(path) as sheet:
        blocks = re.findall(r":root \{(.*?)\n\s*\}", sheet.read(), re.DOTALL)
    block = blocks[0] if theme is LIGHT else blocks[1]
    return dict(re.findall(r"--([a-z]+): (#[0-9a-f]{6});", block))


def contrast(one: str, other: str) -> float:
    """Contrast ratio of two colours as WCAG 2.2 defines it."""

    def luminance(colour: str) -> float:
        channels = [int(colour[start : start + 2], 16) / 255 for start in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
def test_pages_and_figures_agree_on_every_colour(theme: Theme) -> None:
    sheet = properties(theme)

    shared = {
        name: getattr(theme, name) for name in ("ink", "muted", "line", "surface", "best", "default", "limit")
    }
    assert {name: sheet[name] for name in shared} == shared
    assert {name: sheet[name] for name in theme.stages} == theme.stages


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_text_can_be_read(theme: Theme) -> None:
    sheet = properties(theme)

    for ground in ("paper", "surface", "wash"):
        for text in ("ink", "muted", "best"):
            assert contrast(sheet[text], sheet[ground]) >= 4.5, (text, ground)


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_marks_stand_out_from_their_ground(theme: Theme) -> None:
    for colour in (theme.best, theme.default, theme.limit):
        assert contrast(colour, theme.surface) >= 3, colour
