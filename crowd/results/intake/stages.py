"""The stages of a frame whose times SLAM systems report."""

# SLAMBench's stages. Other names are stored with the members that this version does not know.
STAGES = frozenset({"acquisition", "preprocessing", "tracking", "integration", "raycasting", "rendering"})
