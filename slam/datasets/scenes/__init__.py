"""The synthetic scenes, in the order in which searches take them."""

from __future__ import annotations

from slam.datasets.scenes import living_room
from slam.datasets.scenes.scene import Role, SyntheticScene

__all__ = ["SCENES", "Role", "SyntheticScene", "with_role"]

SCENES: dict[str, SyntheticScene] = {
    scene.name: scene
    for scene in (
        living_room.HAND,
        living_room.LOOP,
    )
}


def with_role(role: Role) -> tuple[SyntheticScene, ...]:
    """The scenes of a role, in their order."""
    return tuple(scene for scene in SCENES.values() if scene.role == role)
