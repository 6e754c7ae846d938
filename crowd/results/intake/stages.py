"""The stages of a frame that SLAM systems report times of."""

# KinectFusion and ElasticFusion (slam.system) both have these. A client's own names are not stored.
STAGES = frozenset({"preprocessing", "tracking", "integration", "raycasting"})


def is_public_stage(name: str) -> bool:
    """Whether NAME is a stage of a SLAM system, and not a text that a client made up."""
    return name in STAGES
