"""One palette in two files: the sheet for pages, palette.py for figures."""

import re

import numpy as np
import pytest
from django.contrib.staticfiles import finders

from crowd.dashboard.figures.elements import heat
from crowd.dashboard.figures.palette import DARK, LIGHT, THEMES, Theme, mixed
from crowd.devices.naming.chips import VENDORS


def properties(theme: Theme) -> dict[str, str]:
    """The custom properties that style.css sets in `theme`."""
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
    assert {name: sheet[name.lower()] for name in theme.families} == theme.families


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_text_can_be_read(theme: Theme) -> None:
    sheet = properties(theme)

    for ground in ("paper", "surface", "wash"):
        for text in ("ink", "muted", "best"):
            assert contrast(sheet[text], sheet[ground]) >= 4.5, (text, ground)


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_marks_families_of_chips_and_cells_stand_out_from_their_ground(theme: Theme) -> None:
    cells = heat.COLOURS[theme.name]
    assert theme.families.keys() == VENDORS.keys()
    for colour in (theme.best, theme.default, theme.limit, *theme.families.values(), cells[0]):
        assert contrast(colour, theme.surface) >= 3, colour
    # Cells grow lighter.
    against_black = [contrast(colour, "#000000") for colour in cells]
    assert against_black == sorted(against_black)


# Machado, Oliveira and Fernandes 2009: what people without one kind of cones see, in linear RGB.
VISIONS = {
    "all cones": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
# Distances in OKLab, where 0.02 is about the least that can be seen.
APART = 0.065


def oklab(colours: list[str], vision: np.ndarray) -> np.ndarray:
    """`colours` as `vision` sees them, (n, 3), in Ottosson's OKLab."""
    channels = np.array([[int(each[start : start + 2], 16) / 255 for start in (1, 3, 5)] for each in colours])
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ vision.T, 0, 1)
    cones = (
        seen
        @ np.array(
            [
                [0.4122214708, 0.5363325363, 0.0514459929],
                [0.2119034982, 0.6806995451, 0.1073969566],
                [0.0883024619, 0.2817188376, 0.6299787005],
            ]
        ).T
    )
    return (
        np.cbrt(cones)
        @ np.array(
            [
                [0.2104542553, 0.7936177850, -0.0040720468],
                [1.9779984951, -2.4285922050, 0.4505937099],
                [0.0259040371, 0.7827717662, -0.8086757660],
            ]
        ).T
    )


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
@pytest.mark.parametrize("vision", VISIONS.values(), ids=VISIONS)
def test_every_kind_of_colour_vision_tells_families_of_chips_apart(theme: Theme, vision: np.ndarray) -> None:
    names = list(theme.families)
    seen = oklab(list(theme.families.values()), vision)

    distances = np.linalg.norm(seen[:, None] - seen[None], axis=2) + np.eye(len(names))

    first, second = np.unravel_index(distances.argmin(), distances.shape)
    assert distances.min() >= APART, (names[first], names[second])


def test_a_colour_means_the_same_family_of_chips_in_both_themes() -> None:
    names = list(LIGHT.families)
    light, dark = (oklab(list(theme.families.values()), VISIONS["all cones"]) for theme in (LIGHT, DARK))

    # Themes differ in lightness: hues count more.
    distances = np.linalg.norm((dark[:, None] - light[None]) * [0.45, 1, 1], axis=2)

    assert [names[nearest] for nearest in distances.argmin(axis=1)] == names
    assert [names[nearest] for nearest in distances.argmin(axis=0)] == names


def test_a_colour_laid_over_another_lies_between_them() -> None:
    assert mixed("#ff0000", "#ffffff", 0.0) == "#ffffff"
    assert mixed("#ff0000", "#ffffff", 1.0) == "#ff0000"
    assert mixed("#000000", "#ffffff", 0.5) == "#808080"
