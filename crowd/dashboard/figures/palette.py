"""The colours of figures in two themes. style.css has the same colours as custom properties.

Default is slate and best is orange: colour-blind readers can distinguish them, also by lightness. Stages use
hues of different lightness in a fixed order. Families of chips have distinguishable hues and lightnesses; two
are greys.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Theme:
    """Colours of one theme as #rrggbb."""

    name: str
    ink: str
    muted: str
    line: str
    surface: str
    best: str
    default: str
    limit: str
    stages: dict[str, str]
    series: tuple[str, ...]
    families: dict[str, str]


LIGHT = Theme(
    name="light",
    ink="#131b20",
    muted="#55626a",
    line="#d8dedb",
    surface="#ffffff",
    best="#b8460a",
    default="#6a7f92",
    limit="#a3195b",
    stages={
        "acquisition": "#b4bcc0",
        "preprocessing": "#7db4d3",
        "tracking": "#1f6f9f",
        "integration": "#d99a00",
        "raycasting": "#6b4592",
    },
    series=("#1f6f9f", "#2c8a5b", "#d99a00", "#a3195b", "#6b4592", "#4fa3c7", "#6a7f92"),
    families={
        "Adreno": "#2e97ee",
        "Mali": "#9b7c1a",
        "PowerVR": "#c468c5",
        "Xclipse": "#197e88",
        "Apple": "#676e3a",
        "NVIDIA": "#5f2370",
        "Radeon": "#e06761",
        "Intel": "#11510d",
        "CPU": "#8a9197",
        "other": "#51575c",
    },
)

DARK = Theme(
    name="dark",
    ink="#e9eeec",
    muted="#9dabb1",
    line="#2b363c",
    surface="#151c20",
    best="#ff8f4d",
    default="#8ba0b3",
    limit="#f46ba8",
    stages={
        "acquisition": "#5f6b72",
        "preprocessing": "#a6d3ea",
        "tracking": "#4a9fd1",
        "integration": "#f0bd3f",
        "raycasting": "#b08fd6",
    },
    series=("#4a9fd1", "#4fbd88", "#f0bd3f", "#f46ba8", "#b08fd6", "#a6d3ea", "#8ba0b3"),
    families={
        "Adreno": "#3eafff",
        "Mali": "#c99a1c",
        "PowerVR": "#f077e1",
        "Xclipse": "#149bb1",
        "Apple": "#77996e",
        "NVIDIA": "#884cac",
        "Radeon": "#dd452f",
        "Intel": "#118a34",
        "CPU": "#a2a9a9",
        "other": "#61696f",
    },
)

THEMES = {theme.name: theme for theme in (LIGHT, DARK)}


def mixed(colour: str, ground: str, share: float) -> str:
    """`colour` over `ground` with the opacity `share` (0 to 1), as #rrggbb."""
    pairs = zip(_channels(colour), _channels(ground), strict=True)
    return "#" + "".join(f"{round(share * over + (1 - share) * under):02x}" for over, under in pairs)


def transparent(colour: str, share: float) -> str:
    """`colour` with the opacity `share` (0 to 1), as rgba()."""
    red, green, blue = _channels(colour)
    return f"rgba({red},{green},{blue},{share})"


def _channels(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[start : start + 2], 16) for start in (1, 3, 5))
