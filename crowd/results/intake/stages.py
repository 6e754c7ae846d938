"""The stages of a frame that SLAM systems report times of."""

# Those of SLAMBench. A client's own names are kept with the members that this version does not know.
STAGES = frozenset({"acquisition", "preprocessing", "tracking", "integration", "raycasting", "rendering"})
