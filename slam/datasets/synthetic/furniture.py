"""Furniture for synthetic rooms. Each function puts one piece on a place; its front looks towards -z.

All take the place, a random generator for what is loose, and sizes in metres. A height is above the floor.
"""

from __future__ import annotations

import math

import numpy as np

from slam.datasets.synthetic.place import Material, Place

WOOD = Material((176, 132, 84), "wood", 0.6)
DARK_WOOD = Material((104, 70, 46), "wood", 0.35)
PAINT = Material((236, 234, 228), "plain", 0.85)
PLASTER = Material((224, 212, 190), "plain", 0.8)
WALLPAPER = Material((206, 198, 178), "paper", 0.75)
BRICK = Material((168, 108, 88), "paper", 0.5)
CARPET = Material((132, 112, 98), "weave", 0.45)
TILES = Material((196, 198, 200), "speckle", 0.7)
CLOTH = Material((112, 124, 132), "weave", 0.55)
RED_CLOTH = Material((158, 70, 60), "weave", 0.5)
CARDBOARD = Material((186, 150, 104), "print", 0.65)
PRINT = Material((190, 120, 70), "print", 0.6)
STEEL = Material((150, 154, 158), "plain", 0.3)
BLACK = Material((38, 38, 42), "plain", 0.06)
RUBBER = Material((52, 52, 56), "speckle", 0.09)
GLASS = Material((140, 170, 200), "plain", 0.0)
LEAF = Material((70, 118, 62), "speckle", 0.6)
CLAY = Material((178, 98, 66), "plain", 0.55)
LOOSE = (WOOD, CLOTH, RED_CLOTH, CARDBOARD, PRINT, PAINT, CLAY, LEAF, STEEL, RUBBER)
SKIN = 0.02  # metres: the thickness of fronts, panels and frames


def shell(
    place: Place,
    _rng: np.random.Generator,
    width: float,
    depth: float,
    height: float,
    wall: Material = PLASTER,
    floor: Material = WOOD,
    ceiling: Material = PAINT,
) -> None:
    """Four walls, a floor and a ceiling around the place, with skirting boards."""
    thick = 0.1
    place.add("box", (0, -thick, 0), (width + 1, thick, depth + 1), floor)
    place.add("box", (0, height, 0), (width + 1, thick, depth + 1), ceiling)
    for side in (-1, 1):
        place.add("box", (side * (width + thick) / 2, 0, 0), (thick, height, depth), wall)
        place.add("box", (0, 0, side * (depth + thick) / 2), (width, height, thick), wall)
        place.add("box", (side * (width - SKIN) / 2, 0, 0), (SKIN, 0.09, depth), PAINT)
        place.add("box", (0, 0, side * (depth - SKIN) / 2), (width, 0.09, SKIN), PAINT)


def table(
    place: Place,
    _rng: np.random.Generator,
    width: float = 1.4,
    depth: float = 0.75,
    height: float = 0.74,
    material: Material = WOOD,
) -> None:
    place.add("box", (0, height - 0.04, 0), (width, 0.04, depth), material)
    place.add("box", (0, height - 0.12, 0), (width - 0.1, 0.08, depth - 0.1), material)
    for x in (-1, 1):
        for z in (-1, 1):
            at = (x * (width / 2 - 0.06), 0, z * (depth / 2 - 0.06))
            place.add("frustum", at, (0.06, height - 0.04, 0.06), material)


def chair(
    place: Place, _rng: np.random.Generator, seat: Material = RED_CLOTH, frame: Material = WOOD
) -> None:
    place.add("rounded", (0, 0.42, 0), (0.44, 0.06, 0.44), seat, edge=0.02)
    place.add("rounded", (0, 0.55, 0.2), (0.42, 0.42, 0.05), seat, (0, 8, 0), edge=0.02)
    for x in (-0.18, 0.18):
        for z in (-0.18, 0.18):
            place.add("frustum", (x, 0, z), (0.04, 0.43, 0.04), frame)


def office_chair(place: Place, _rng: np.random.Generator, cloth: Material = RUBBER) -> None:
    """A swivel chair of dark cloth on five feet."""
    place.add("rounded", (0, 0.45, 0), (0.5, 0.09, 0.48), cloth, edge=0.03)
    place.add("rounded", (0, 0.6, 0.24), (0.46, 0.55, 0.07), cloth, (0, 7, 0), edge=0.03)
    place.add("frustum", (0, 0.1, 0), (0.06, 0.36, 0.06), STEEL)
    for number in range(5):
        yaw = 72.0 * number
        x, z = 0.15 * math.sin(math.radians(yaw)), 0.15 * math.cos(math.radians(yaw))
        place.add("box", (x, 0.06, z), (0.05, 0.04, 0.32), STEEL, (yaw, 0, 0))
        place.add("ellipsoid", (2 * x, 0, 2 * z), (0.06, 0.06, 0.06), RUBBER)


def shelf(
    place: Place,
    rng: np.random.Generator,
    width: float = 1.2,
    height: float = 2.0,
    depth: float = 0.3,
    rows: int = 5,
    material: Material = WOOD,
    back: bool = True,
) -> None:
    """Shelves with books of different sizes, gaps between them, and boxes."""
    for x in (-1, 1):
        place.add("box", (x * (width - SKIN) / 2, 0, 0), (SKIN, height, depth), material)
    if back:
        place.add("box", (0, 0, depth / 2), (width, height, SKIN), material)
    pitch = (height - 0.06) / rows
    for row in range(rows + 1):
        place.add("box", (0, 0.04 + row * pitch, 0), (width, SKIN, depth), material)
    for row in range(rows):
        _row(place, rng, width - 0.08, 0.06 + row * pitch, pitch - 0.06, depth)


def _row(
    place: Place, rng: np.random.Generator, width: float, bottom: float, tall: float, depth: float
) -> None:
    """The content of a shelf: mostly books, and now and then a box or a gap."""
    x = -width / 2
    while x < width / 2 - 0.12:
        material = LOOSE[rng.integers(len(LOOSE))]
        high, deep = tall * rng.uniform(0.6, 0.95), depth * rng.uniform(0.5, 0.9)
        kind = rng.random()
        if kind < 0.15:
            x += rng.uniform(0.05, 0.2)
            continue
        wide = rng.uniform(0.12, 0.24) if kind < 0.35 else rng.uniform(0.03, 0.07)
        wide = min(wide, width / 2 - x)
        place.add("box", (x + wide / 2, bottom, (depth - deep) / 2 - 0.02), (wide, high, deep), material)
        x += wide + rng.uniform(0.002, 0.01)


def cupboard(
    place: Place,
    _rng: np.random.Generator,
    width: float = 1.0,
    height: float = 0.9,
    depth: float = 0.45,
    doors: int = 2,
    material: Material = PAINT,
    bottom: float = 0.0,
    top: Material | None = None,
) -> None:
    """A cupboard with raised doors and knobs; with `bottom` it hangs on the wall, `top` is its worktop."""
    place.add("box", (0, bottom, 0), (width, height, depth), material)
    wide = width / doors
    for number in range(doors):
        x = (number + 0.5) * wide - width / 2
        place.add("box", (x, bottom + 0.04, -depth / 2), (wide - 0.03, height - 0.08, 2 * SKIN), material)
        knob = (x + 0.38 * wide, bottom + 0.6 * height, -depth / 2 - 0.035)
        place.add("ellipsoid", knob, (0.035, 0.035, 0.035), STEEL)
    if top is not None:
        place.add("box", (0, bottom + height, -0.01), (width, 0.04, depth + 0.04), top)


def oven(place: Place, _rng: np.random.Generator) -> None:
    """A built-in cooker: a dark glass door, a handle, black hobs and two pots."""
    place.add("box", (0, 0, 0), (0.6, 0.9, 0.58), STEEL)
    place.add("box", (0, 0.2, -0.29), (0.54, 0.5, 0.02), BLACK)
    place.add("frustum", (-0.22, 0.74, -0.33), (0.025, 0.44, 0.025), STEEL, (0, 0, 90))
    place.add("box", (0, 0.9, 0), (0.6, 0.012, 0.56), BLACK)
    place.add("frustum", (-0.14, 0.912, 0.1), (0.24, 0.16, 0.24), STEEL)
    place.add("frustum", (0.15, 0.912, -0.1), (0.18, 0.1, 0.18), RED_CLOTH)


def monitor(place: Place, _rng: np.random.Generator, height: float = 0.74, width: float = 0.55) -> None:
    """A black monitor on a desk of this height, and a keyboard before it. The screen sends nothing back."""
    tall = 0.6 * width
    place.add("frustum", (0, height, 0.02), (0.22, 0.015, 0.22), STEEL)
    place.add("frustum", (0, height, 0.04), (0.05, 0.2, 0.05), STEEL)
    place.add("box", (0, height + 0.12, 0), (width, tall, 0.04), RUBBER)
    place.add("box", (0, height + 0.14, -0.02), (width - 0.04, tall - 0.05, 0.01), GLASS)
    place.add("box", (0, height, -0.3), (0.44, 0.025, 0.15), RUBBER)
    place.add("ellipsoid", (0.32, height, -0.3), (0.06, 0.035, 0.1), PAINT)


def lamp(place: Place, _rng: np.random.Generator, bottom: float = 0.0, height: float = 1.6) -> None:
    size = 0.25 * height + 0.05
    place.add("frustum", (0, bottom, 0), (0.6 * size, 0.03, 0.6 * size), STEEL)
    place.add("frustum", (0, bottom, 0), (0.03, height, 0.03), STEEL)
    place.add("frustum", (0, bottom + height - 0.6 * size, 0), (size, 0.6 * size, size), PAINT, top=0.6)


def plant(place: Place, rng: np.random.Generator, bottom: float = 0.0, height: float = 1.1) -> None:
    """A pot with leaves that point in all directions."""
    pot = 0.25 * height
    place.add("frustum", (0, bottom, 0), (pot, pot, pot), CLAY, top=1.3)
    place.add("frustum", (0, bottom + pot, 0), (0.03, height - 1.5 * pot, 0.03), DARK_WOOD)
    for _ in range(16):
        yaw, rise = rng.uniform(0, 360), rng.uniform(-40, 40)
        reach, up = 0.2 * height * rng.uniform(0.2, 1), rng.uniform(1.2 * pot, height)
        x, z = reach * math.cos(math.radians(yaw)), reach * math.sin(math.radians(yaw))
        length = height * rng.uniform(0.18, 0.3)
        place.add("ellipsoid", (x, bottom + up, z), (length, 0.02, 0.4 * length), LEAF, (-yaw, 0, -rise))


def clutter(
    place: Place,
    rng: np.random.Generator,
    width: float,
    depth: float,
    count: int,
    bottom: float = 0.0,
    smallest: float = 0.06,
    largest: float = 0.3,
) -> None:
    """`count` loose things on a rectangle at the height `bottom`: boxes, cylinders, balls and cushions."""
    for _ in range(count):
        x, z = rng.uniform(-width / 2, width / 2), rng.uniform(-depth / 2, depth / 2)
        size = rng.uniform(smallest, largest, 3)
        yaw = rng.uniform(0, 360)
        material = LOOSE[rng.integers(len(LOOSE))]
        kind = ("box", "box", "frustum", "ellipsoid", "rounded")[rng.integers(5)]
        if kind == "frustum":
            place.add(
                "frustum", (x, bottom, z), (size[0], size[1], size[0]), material, top=rng.uniform(0.5, 1.2)
            )
        elif kind == "box":
            place.add("box", (x, bottom, z), tuple(size), material, (yaw, 0, 0))
        elif kind == "ellipsoid":
            place.add("ellipsoid", (x, bottom, z), tuple(size), material, (yaw, 0, 0))
        else:
            place.add("rounded", (x, bottom, z), tuple(size), material, (yaw, 0, 0), edge=0.3 * size.min())


def boxes(place: Place, rng: np.random.Generator, count: int = 3, size: float = 0.4) -> None:
    """A stack of cardboard boxes, each turned a little."""
    height = 0.0
    for _ in range(count):
        wide, tall, deep = size * rng.uniform(0.7, 1.0, 3)
        place.add("box", (0, height, 0), (wide, tall, deep), CARDBOARD, (rng.uniform(-25, 25), 0, 0))
        height += tall


def bed(place: Place, _rng: np.random.Generator, width: float = 1.4, length: float = 2.0) -> None:
    """A bed whose head is at +z, with two pillows and a turned-back blanket."""
    place.add("box", (0, 0.12, 0), (width, 0.2, length), DARK_WOOD)
    place.add("rounded", (0, 0.3, 0), (width - 0.04, 0.2, length - 0.06), PAINT, edge=0.06)
    place.add("rounded", (0, 0.42, -0.25), (width + 0.02, 0.13, 0.68 * length), RED_CLOTH, edge=0.06)
    place.add("box", (0, 0.1, length / 2), (width, 0.8, 0.05), DARK_WOOD)
    for side in (-1, 1):
        at = (side * width / 4, 0.48, 0.36 * length)
        place.add("rounded", at, (0.42 * width, 0.16, 0.4), PAINT, (8 * side, 15, 0), edge=0.075)
        place.add("frustum", (side * width / 2.2, 0, -0.45 * length), (0.07, 0.14, 0.07), DARK_WOOD)


def door(place: Place, _rng: np.random.Generator, material: Material = WOOD) -> None:
    """A door in the wall behind the place, with its frame, two panels and a handle."""
    place.add("box", (0, 0, 0), (0.85, 2.0, 2 * SKIN), material)
    for low, tall in ((0.2, 0.7), (1.05, 0.8)):
        place.add("box", (0, low, -SKIN), (0.55, tall, 2 * SKIN), material)
    for side in (-1, 1):
        place.add("box", (0.46 * side, 0, -SKIN), (0.08, 2.06, 0.1), PAINT)
    place.add("box", (0, 2.0, -SKIN), (1.0, 0.08, 0.1), PAINT)
    place.add("box", (0.34, 1.0, -0.06), (0.13, 0.025, 0.025), STEEL)


def window(
    place: Place,
    _rng: np.random.Generator,
    width: float = 1.2,
    height: float = 1.2,
    bottom: float = 0.9,
) -> None:
    """A window before the wall: panes that send nothing back, a frame, a sill and a radiator below."""
    place.add("box", (0, bottom, 0), (width, height, SKIN), GLASS)
    for side in (-1, 0, 1):
        place.add("box", (side * width / 2, bottom, -0.02), (0.07, height, 0.07), PAINT)
    for bottom_of_bar in (bottom, bottom + height - 0.07):
        place.add("box", (0, bottom_of_bar, -0.02), (width, 0.07, 0.07), PAINT)
    place.add("box", (0, bottom - 0.04, -0.1), (width + 0.1, 0.04, 0.26), PAINT)
    for fin in range(int(width / 0.09)):
        x = 0.09 * fin - width / 2 + 0.06
        place.add("box", (x, 0.14, -0.08), (0.05, bottom - 0.3, 0.1), PAINT)


def picture(
    place: Place,
    _rng: np.random.Generator,
    width: float = 0.6,
    height: float = 0.45,
    bottom: float = 1.3,
    material: Material = PRINT,
) -> None:
    place.add("box", (0, bottom, 0), (width, height, 0.02), material)
    for side in (-1, 1):
        place.add("box", (side * width / 2, bottom, -0.015), (0.04, height, 0.05), DARK_WOOD)
        y = bottom + (height + side * height) / 2 - 0.02
        place.add("box", (0, y, -0.015), (width + 0.04, 0.04, 0.05), DARK_WOOD)


def coats(place: Place, rng: np.random.Generator, count: int = 5) -> None:
    """Coats on a rail in front of the wall, some of them black."""
    place.add("box", (0, 1.7, 0), (0.2 * count + 0.2, 0.1, 0.04), DARK_WOOD)
    for number in range(count):
        cloth = (CLOTH, RED_CLOTH, RUBBER, CARDBOARD)[rng.integers(4)]
        x, tall = 0.2 * (number - (count - 1) / 2), rng.uniform(0.7, 1.1)
        place.add("rounded", (x, 1.72 - tall, -0.12), (0.18, tall, 0.2), cloth, edge=0.07)


def beam(
    place: Place,
    _rng: np.random.Generator,
    length: float,
    bottom: float,
    size: float = 0.14,
    material: Material = DARK_WOOD,
) -> None:
    """A beam along x below the ceiling."""
    place.add("box", (0, bottom, 0), (length, size, size), material)


def slope(
    place: Place, _rng: np.random.Generator, width: float, length: float, bottom: float, angle: float
) -> None:
    """A sloping ceiling along x whose middle lies at the height `bottom`, falling towards +z by `angle`."""
    place.add("box", (0, bottom, 0), (width, 0.1, length), PLASTER, (0, -angle, 0))


def pillar(
    place: Place, _rng: np.random.Generator, width: float, height: float, material: Material = BRICK
) -> None:
    place.add("frustum", (0, 0, 0), (width, height, width), material)
    place.add("frustum", (0, 0, 0), (1.4 * width, 0.12, 1.4 * width), material, top=0.8)
