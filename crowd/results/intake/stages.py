"""temporary"""

STAGES = frozenset(
    {
        "acquisition",
        "preprocessing",
        "tracking",
        "integration",
        "raycasting",
        "computation",
        "total",
        "rendering",
    }
)
