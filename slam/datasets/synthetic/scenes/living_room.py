"""The living room: the sequence that clients measure, and a loop through the whole room with colour.

The hand's path has two hurried stretches, on which careless configurations lose track. On the loop the walls
are patterned and furniture stands all around, for depth and colour to hold on to; after one turn the camera
sees the start again.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from slam.datasets.synthetic import camera_paths
from slam.datasets.synthetic.place import Colour, Place, turn
from slam.datasets.synthetic.scenes.scene import SyntheticScene
from slam.datasets.synthetic.shapes import Pattern, Shape

HEIGHT = 2.55
LEFT, RIGHT, BACK, FRONT = -2.2, 2.2, 2.1, -2.3
WINDOW = 1.0  # x of its middle, in the back wall

OAK, WALNUT, WHITE, CREAM = (176, 132, 84), (104, 70, 46), (236, 234, 228), (224, 212, 190)
STEEL, BLACK, GREEN, TERRACOTTA = (150, 154, 158), (38, 38, 42), (70, 118, 62), (178, 98, 66)
SPINES: tuple[Colour, ...] = (
    (150, 52, 48),
    (46, 84, 128),
    (204, 168, 80),
    (58, 104, 82),
    (210, 204, 190),
    (92, 62, 108),
    (196, 110, 54),
    (52, 54, 62),
)


def living_room(seed: int = 0, all_around: bool = False) -> list[Shape]:
    """All shapes of the room. The furniture stays; the seed deals books, leaves and fruit.

    `all_around` papers the walls and furnishes the end that lies behind a camera which looks at the sofa.
    """
    rng = np.random.default_rng([seed, 1])
    shapes: list[Shape] = []
    walls: Pattern = "paper" if all_around else "plain"
    _walls(Place(shapes), walls)
    _window(Place(shapes, WINDOW, BACK), walls)
    _pictures(Place(shapes, -0.55, BACK))
    _sofa(Place(shapes, -0.55, 1.55))
    _coffee_table(Place(shapes, -0.25, 0.45, 8), rng)
    _armchair(Place(shapes, -1.62, 0.55, -58))
    _bookshelf(Place(shapes, 2.04, 0.75, 90), rng)
    _lamp(Place(shapes, -1.85, 1.75))
    _plant(Place(shapes, 1.72, 1.62), rng)
    _cabinet(Place(shapes, -2.0, -0.65, -90))
    _stool(Place(shapes, 0.95, 0.35, 25))
    _clutter(Place(shapes, 0.0, 0.0), rng)
    if all_around:
        _far_end(Place(shapes, 0.0, FRONT, 180), rng)
        _chair(Place(shapes, 1.35, FRONT + 0.75, 215))
    return shapes


def _walls(room: Place, pattern: Pattern) -> None:
    width, depth = RIGHT - LEFT, BACK - FRONT
    middle = (FRONT + BACK) / 2
    room.put("box", (0, -0.1, middle), (width + 1, 0.1, depth + 1), OAK, "wood")
    room.put("box", (0, HEIGHT, middle), (width + 1, 0.1, depth + 1), WHITE)
    room.put("box", (LEFT - 0.05, 0, middle), (0.1, HEIGHT, depth), CREAM, pattern)
    room.put("box", (RIGHT + 0.05, 0, middle), (0.1, HEIGHT, depth), CREAM, pattern)
    room.put("box", (0, 0, FRONT - 0.05), (width, HEIGHT, 0.1), CREAM, pattern)
    for side in (LEFT + 0.01, RIGHT - 0.01):
        room.put("box", (side, 0, middle), (0.02, 0.09, depth), WHITE)
    # A door on the left wall, with its frame and two panels.
    for z, w in ((-1.75, 0.07), (-0.93, 0.07)):
        room.put("box", (LEFT + 0.025, 0, z), (0.05, 2.05, w), WHITE)
    room.put("box", (LEFT + 0.025, 2.0, -1.34), (0.05, 0.07, 0.89), WHITE)
    room.put("box", (LEFT + 0.012, 0, -1.34), (0.024, 2.0, 0.75), OAK, "wood")
    for bottom, tall in ((0.2, 0.7), (1.05, 0.8)):
        room.put("box", (LEFT + 0.03, bottom, -1.34), (0.02, tall, 0.5), OAK, "wood")
    # A beam and a pendant lamp.
    room.put("box", (0, HEIGHT - 0.16, 0.9), (width, 0.16, 0.14), WALNUT, "wood")
    room.put("frustum", (0.15, 1.95, 0.9), (0.012, 0.45, 0.012), BLACK)
    room.put("frustum", (0.15, 1.78, 0.9), (0.4, 0.2, 0.4), TERRACOTTA, "weave", top=0.3)
    room.put("box", (-0.2, 0.0, 0.5), (2.1, 0.014, 1.5), (126, 60, 58), "print", turn(4))


def _window(place: Place, pattern: Pattern) -> None:
    """The back wall around an opening with a recess 22 cm deep, a radiator below and curtains."""
    thick, low, high, half = 0.22, 0.92, 2.1, 0.5
    z = thick / 2
    # The wall's ends, seen from the middle of the window.
    left, right = LEFT - WINDOW, RIGHT - WINDOW
    place.put("box", ((left - half) / 2, 0, z), (-half - left, HEIGHT, thick), CREAM, pattern)
    place.put("box", ((right + half) / 2, 0, z), (right - half, HEIGHT, thick), CREAM, pattern)
    place.put("box", (0, 0, z), (2 * half, low, thick), CREAM, pattern)
    place.put("box", (0, high, z), (2 * half, HEIGHT - high, thick), CREAM, pattern)
    place.put("box", (0, 0, thick + 0.05), (2 * half + 0.4, HEIGHT, 0.02), (140, 170, 200), mirror=True)
    for x in (-half + 0.03, 0.0, half - 0.03):
        place.put("box", (x, low, thick - 0.03), (0.06, high - low, 0.05), WHITE)
    for y in (low, 1.55, high - 0.06):
        place.put("box", (0, y, thick - 0.03), (2 * half, 0.06, 0.05), WHITE)
    place.put("box", (0, low - 0.04, 0.02), (2 * half + 0.1, 0.04, 0.34), WHITE)
    place.put("frustum", (-0.3, low, 0.02), (0.14, 0.15, 0.14), TERRACOTTA, top=1.3)
    place.put("ellipsoid", (-0.3, low + 0.13, 0.02), (0.2, 0.2, 0.2), GREEN, "speckle")
    for fin in range(12):
        place.put("rounded", (-0.44 + 0.08 * fin, 0.14, -0.07), (0.05, 0.6, 0.1), WHITE, edge=0.02)
    for side in (-1, 1):
        for fold in range(6):
            x, z = side * (half + 0.03 + 0.055 * fold), -0.09 - 0.035 * (fold % 2)
            place.put("frustum", (x, 0.06, z), (0.075, 2.2, 0.075), (88, 112, 128), "weave")
    place.put("box", (0, 2.26, -0.11), (2.0, 0.03, 0.03), BLACK)
    # What is left of the back wall has a skirting board.
    place.put("box", (-1.9, 0, -0.01), (2.6, 0.09, 0.02), WHITE)


def _pictures(place: Place) -> None:
    for x, low, width, height, colour in (
        (-0.75, 1.25, 0.5, 0.65, (70, 110, 140)),
        (0.0, 1.35, 0.7, 0.5, (190, 120, 70)),
        (0.6, 1.2, 0.3, 0.4, (90, 130, 80)),
    ):
        place.put("box", (x, low, -0.01), (width, height, 0.02), colour, "print")
        for side in (-1, 1):
            place.put("box", (x + side * width / 2, low, -0.025), (0.04, height, 0.05), WALNUT, "wood")
        for y in (low - 0.02, low + height - 0.02):
            place.put("box", (x, y, -0.025), (width + 0.04, 0.04, 0.05), WALNUT, "wood")


def _sofa(place: Place) -> None:
    cloth = (112, 124, 132)
    place.put("rounded", (0, 0.08, 0), (1.9, 0.24, 0.85), cloth, "weave", edge=0.05)
    place.put("rounded", (0, 0.25, 0.33), (1.75, 0.62, 0.22), cloth, "weave", turn(0, 9), edge=0.09)
    for x in (-0.88, 0.88):
        place.put("rounded", (x, 0.1, -0.02), (0.2, 0.52, 0.86), cloth, "weave", edge=0.08)
    for x in (-0.4, 0.4):
        place.put("rounded", (x, 0.31, -0.08), (0.77, 0.15, 0.66), (122, 134, 142), "weave", edge=0.06)
    for x, y, yaw, roll, colour in (
        (-0.6, 0.44, 14, 20, (196, 148, 60)),
        (-0.2, 0.43, -6, -12, (150, 70, 60)),
        (0.6, 0.45, -20, 35, (80, 120, 130)),
    ):
        place.put("rounded", (x, y, 0.12), (0.42, 0.4, 0.15), colour, "print", turn(yaw, 20, roll), edge=0.07)
    for x in (-0.85, 0.85):
        for z in (-0.36, 0.36):
            place.put("frustum", (x, 0, z), (0.05, 0.09, 0.05), WALNUT)


def _coffee_table(place: Place, rng: np.random.Generator) -> None:
    place.put("rounded", (0, 0.4, 0), (1.05, 0.045, 0.6), WALNUT, "wood", edge=0.015)
    place.put("box", (0, 0.15, 0), (0.9, 0.02, 0.48), WALNUT, "wood")
    for x in (-0.47, 0.47):
        for z in (-0.25, 0.25):
            place.put("frustum", (x, 0, z), (0.055, 0.41, 0.055), WALNUT, top=1.3)
    height = 0.445
    for width, yaw in ((0.24, 12), (0.21, -8), (0.18, 30)):
        colour = SPINES[rng.integers(len(SPINES))]
        place.put("box", (-0.3, height, 0.05), (width, 0.03, width * 1.3), colour, "print", turn(yaw))
        height += 0.03
    place.put("frustum", (0.08, 0.445, 0.02), (0.28, 0.09, 0.28), CREAM, top=1.35)
    for _ in range(6):
        x, z = rng.uniform(-0.08, 0.08, 2)
        colour = ((190, 60, 40), (220, 160, 50), (130, 160, 60))[rng.integers(3)]
        place.put("ellipsoid", (0.08 + x, 0.5, 0.02 + z), (0.075, 0.075, 0.075), colour, "speckle")
    place.put("frustum", (0.36, 0.445, -0.12), (0.08, 0.1, 0.08), (60, 90, 130))
    place.put("box", (0.36, 0.17, 0.05), (0.3, 0.06, 0.22), (90, 90, 96), "print", turn(17))
    place.put("frustum", (-0.2, 0.17, -0.05), (0.2, 0.12, 0.2), TERRACOTTA, "speckle", top=0.7)


def _armchair(place: Place) -> None:
    cloth = (168, 112, 62)
    place.put("rounded", (0, 0.14, 0), (0.74, 0.26, 0.72), cloth, "weave", edge=0.07)
    place.put("rounded", (0, 0.3, 0.3), (0.7, 0.6, 0.18), cloth, "weave", turn(0, 12), edge=0.08)
    for x in (-0.36, 0.36):
        place.put("rounded", (x, 0.14, -0.02), (0.15, 0.46, 0.7), cloth, "weave", edge=0.06)
        for z in (-0.28, 0.28):
            place.put("frustum", (x * 0.85, 0, z), (0.045, 0.16, 0.045), WALNUT, top=1.4)
    place.put("rounded", (0.05, 0.42, 0.1), (0.4, 0.36, 0.14), CREAM, "print", turn(12, 22, 15), edge=0.065)
    # A blanket over one arm.
    place.put("rounded", (-0.36, 0.36, -0.12), (0.2, 0.26, 0.4), (120, 140, 110), "weave", edge=0.05)


def _bookshelf(place: Place, rng: np.random.Generator) -> None:
    """Faces the room with its open side towards -z; books differ in width, height, depth and lean."""
    width, height, depth = 1.3, 2.05, 0.3
    for x in (-width / 2, 0.0, width / 2):
        place.put("box", (x, 0, 0), (0.03, height, depth), OAK, "wood")
    place.put("box", (0, 0, depth / 2), (width, height, 0.015), OAK, "wood")
    shelves = (0.06, 0.45, 0.84, 1.23, 1.62, height - 0.03)
    for y in shelves:
        place.put("box", (0, y, 0), (width, 0.03, depth), OAK, "wood")
    for y in shelves[:-1]:
        for begin in (-width / 2 + 0.03, 0.03):
            _books(place, begin, begin + width / 2 - 0.08, y + 0.03, rng)


def _books(place: Place, begin: float, end: float, bottom: float, rng: np.random.Generator) -> None:
    """A row of books that is full, half full or shares its shelf with a vase."""
    filled = begin + (end - begin) * rng.choice([0.55, 0.8, 1.0])
    x = begin
    while x < filled - 0.06:
        width, height, depth = rng.uniform(0.022, 0.055), rng.uniform(0.2, 0.31), rng.uniform(0.14, 0.22)
        lean = rng.uniform(4, 11) if rng.random() < 0.12 else 0.0
        colour = SPINES[rng.integers(len(SPINES))]
        place.put(
            "box", (x + width / 2, bottom, 0.05), (width, height, depth), colour, "speckle", turn(0, 0, lean)
        )
        x += width + rng.uniform(0.001, 0.006) + (0.05 if lean else 0.0)
    if end - filled > 0.1:
        size = rng.uniform(0.1, 0.14)
        place.put(
            "frustum", (end - 0.07, bottom, -0.02), (size, size * 1.6, size), TERRACOTTA, "speckle", top=0.55
        )


def _lamp(place: Place) -> None:
    place.put("frustum", (0, 0, 0), (0.3, 0.03, 0.3), BLACK)
    place.put("frustum", (0, 0.03, 0), (0.028, 1.45, 0.028), STEEL)
    place.put("frustum", (0, 1.4, 0), (0.42, 0.3, 0.42), CREAM, "weave", top=0.6)


def _plant(place: Place, rng: np.random.Generator) -> None:
    place.put("frustum", (0, 0, 0), (0.26, 0.32, 0.26), TERRACOTTA, "speckle", top=1.35)
    place.put("frustum", (0, 0.3, 0), (0.03, 0.75, 0.03), (96, 84, 54))
    for _ in range(34):
        yaw, rise = rng.uniform(0, 360), rng.uniform(-50, 40)
        reach, up = rng.uniform(0.05, 0.24), rng.uniform(0.42, 1.25)
        x, z = reach * math.cos(math.radians(yaw)), reach * math.sin(math.radians(yaw))
        leaf = turn(-yaw, 0, -rise)
        length = rng.uniform(0.2, 0.34)
        place.put("ellipsoid", (x, up, z), (length, 0.02, length * 0.4), GREEN, "speckle", leaf)


def _cabinet(place: Place) -> None:
    """A low cabinet with a dark screen, which sends nothing back, and two speakers."""
    place.put("box", (0, 0.06, 0), (1.4, 0.42, 0.38), WALNUT, "wood")
    for x in (-0.47, 0.0, 0.47):
        place.put("box", (x, 0.1, -0.195), (0.43, 0.34, 0.02), OAK, "wood")
        place.put("ellipsoid", (x + 0.15, 0.25, -0.215), (0.03, 0.03, 0.03), STEEL)
    place.put("box", (0, 0.55, 0.05), (0.95, 0.56, 0.04), BLACK)
    place.put("box", (0, 0.58, 0.025), (0.89, 0.5, 0.01), BLACK, mirror=True)
    place.put("box", (0, 0.48, 0.05), (0.3, 0.08, 0.18), BLACK)
    for x in (-0.6, 0.6):
        place.put("rounded", (x, 0.48, 0.05), (0.16, 0.28, 0.2), WALNUT, "wood", edge=0.02)
        place.put("frustum", (x, 0.55, -0.045), (0.11, 0.02, 0.11), BLACK, tilt=turn(0, 90))


def _stool(place: Place) -> None:
    place.put("rounded", (0, 0.3, 0), (0.44, 0.14, 0.44), (176, 92, 72), "weave", edge=0.06)
    for x in (-0.15, 0.15):
        for z in (-0.15, 0.15):
            place.put("frustum", (x, 0, z), (0.04, 0.32, 0.04), OAK, top=1.2)
    place.put("box", (0.02, 0.44, 0.02), (0.3, 0.025, 0.21), (70, 74, 80), "print", turn(-18))


def _clutter(place: Place, rng: np.random.Generator) -> None:
    """Things on the floor: a basket, a ball, toy blocks, a pile of magazines."""
    place.put("frustum", (1.3, 0, 1.05), (0.36, 0.3, 0.36), (190, 160, 110), "weave", top=1.2)
    place.put("ellipsoid", (1.3, 0.2, 1.05), (0.3, 0.24, 0.3), (220, 214, 200), "speckle")
    place.put("ellipsoid", (-0.98, 0.014, 0.2), (0.2, 0.2, 0.2), (190, 60, 50), "speckle")
    for _ in range(9):
        x, z, yaw = rng.uniform(-0.95, -0.65), rng.uniform(-0.25, 0.05), rng.uniform(0, 90)
        colour = SPINES[rng.integers(len(SPINES))]
        place.put("box", (x, 0.014, z), (0.06, 0.06, 0.06), colour, "plain", turn(yaw))
    for number in range(5):
        yaw = rng.uniform(-12, 12)
        place.put(
            "box", (1.45, 0.02 * number, -0.35), (0.22, 0.02, 0.3), SPINES[number], "print", turn(30 + yaw)
        )


def _far_end(place: Place, rng: np.random.Generator) -> None:
    """Along the wall opposite the sofa, x to the left of who looks at it from the sofa: a chest, coats."""
    place.put("box", (-0.9, 0.1, -0.24), (1.2, 0.75, 0.42), OAK, "wood")
    for x in (-1.2, -0.6):
        for low in (0.14, 0.5):
            place.put("box", (x, low, -0.46), (0.54, 0.32, 0.02), WALNUT, "wood")
            place.put("ellipsoid", (x, low + 0.15, -0.48), (0.03, 0.03, 0.03), STEEL)
    for x, size, colour in ((-1.35, 0.2, TERRACOTTA), (-0.55, 0.15, (60, 90, 130)), (-0.8, 0.11, GREEN)):
        place.put("frustum", (x, 0.85, -0.22), (size, 2 * size, size), colour, "speckle", top=0.6)
    height = 0.85
    for width, yaw in ((0.3, 8), (0.26, -14), (0.22, 25)):
        colour = SPINES[rng.integers(len(SPINES))]
        place.put("box", (-1.08, height, -0.24), (width, 0.045, 0.75 * width), colour, "print", turn(yaw))
        height += 0.045
    for x, low, width, tall, colour in (
        (-0.95, 1.45, 0.8, 0.55, (150, 80, 70)),
        (0.1, 1.3, 0.45, 0.6, (70, 110, 150)),
        (1.55, 1.15, 0.6, 0.8, (110, 120, 60)),
    ):
        place.put("box", (x, low, -0.02), (width, tall, 0.04), colour, "print")
    for number in range(4):
        colour = SPINES[rng.integers(len(SPINES))]
        place.put(
            "rounded", (0.65 + 0.16 * number, 0.75, -0.12), (0.14, 0.85, 0.2), colour, "weave", edge=0.06
        )
    place.put("box", (0.9, 1.6, -0.03), (0.8, 0.1, 0.06), WALNUT, "wood")
    place.put("frustum", (0.2, 0, -0.3), (0.32, 0.55, 0.32), (190, 160, 110), "weave", top=1.1)


def _chair(place: Place) -> None:
    place.put("rounded", (0, 0.42, 0), (0.44, 0.06, 0.44), OAK, "wood", edge=0.02)
    place.put("rounded", (0, 0.55, 0.2), (0.42, 0.42, 0.05), (80, 120, 130), "weave", turn(0, 8), edge=0.02)
    for x in (-0.18, 0.18):
        for z in (-0.18, 0.18):
            place.put("frustum", (x, 0, z), (0.04, 0.43, 0.04), OAK)


# Each volume is a cube in the axes of the first camera. The hand's path sees one end of the room only.
HAND = SyntheticScene(
    name="living-room",
    role="learned-on",
    summary="a furnished living room seen from a hand, 10 mm a frame with two hurried stretches",
    shapes=living_room,
    poses=camera_paths.hand_held,
    volume_size=4.8,
    initial_position=(0.5, 0.48, 0.1),
)
LOOP = SyntheticScene(
    name="living-room-loop",
    role="loop",
    summary="the same room, papered and furnished on all sides: once round and on past the start",
    shapes=partial(living_room, all_around=True),
    poses=camera_paths.loop,
    volume_size=5.4,
    initial_position=(0.5, 0.48, 0.5),
    frames=400,
)
