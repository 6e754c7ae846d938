"""The synthetic scenes, in the order in which searches take them."""

from __future__ import annotations

from slam.datasets.synthetic.scenes import living_room
from slam.datasets.synthetic.scenes.attic import ATTIC
from slam.datasets.synthetic.scenes.corridor import CORRIDOR
from slam.datasets.synthetic.scenes.desk import DESK
from slam.datasets.synthetic.scenes.kitchen import KITCHEN
from slam.datasets.synthetic.scenes.library import LIBRARY
from slam.datasets.synthetic.scenes.office import OFFICE
from slam.datasets.synthetic.scenes.scene import Role, SyntheticScene
from slam.datasets.synthetic.scenes.studio import STUDIO
from slam.datasets.synthetic.scenes.workshop import WORKSHOP

__all__ = ["SCENES", "Role", "SyntheticScene", "with_role"]

SCENES: dict[str, SyntheticScene] = {
    scene.name: scene
    for scene in (
        living_room.HAND,
        DESK,
        KITCHEN,
        OFFICE,
        CORRIDOR,
        ATTIC,
        WORKSHOP,
        LIBRARY,
        living_room.LOOP,
        STUDIO,
    )
}


def with_role(role: Role) -> tuple[SyntheticScene, ...]:
    """The scenes of a role, in their order."""
    return tuple(scene for scene in SCENES.values() if scene.role == role)
