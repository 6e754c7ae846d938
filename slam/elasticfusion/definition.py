"""ElasticFusion, without a device."""

from __future__ import annotations

from slam.elasticfusion.configuration import Configuration
from slam.system import Definition, Parameter

FLAG = (0, 1)


def _warm_up(open_loop: bool) -> Configuration:
    """A small map that is left and revisited within a few frames, with every loop accepted."""
    return Configuration(
        open_loop=open_loop,
        relocalisation=False,
        time_window=12,
        confidence_threshold=1,
        icp_count_threshold=0,
        icp_error_threshold=1.0,
        icp_deviation_threshold=1.0,
        fern_deviation_threshold=1.0,
        surfel_capacity=50_000,
    )


ELASTICFUSION = Definition(
    title="ElasticFusion",
    complete=lambda values: Configuration.from_mapping(values).to_dict(),
    backends=("opencl",),
    colour=True,
    size_multiple=lambda values: int(values["compute_size_ratio"]),
    warm_up=lambda values: _warm_up(bool(values["open_loop"])).to_dict(),
    parameters={
        "icp_weight": Parameter(
            (0, 0.5, *range(1, 21), 50, 100),
            "weight of depth beside brightness in tracking; 0: brightness alone",
        ),
        "depth_cutoff": Parameter(
            tuple(0.5 * half for half in range(2, 26)), "depth beyond it is not used", "m"
        ),
        "confidence_threshold": Parameter(tuple(range(1, 25)), "a surfel of this confidence is stable"),
        "disable_so3": Parameter(FLAG, "no alignment by rotation before the registration"),
        "open_loop": Parameter(FLAG, "no loops are closed, and the whole map is active"),
        "relocalisation": Parameter(FLAG, "a lost camera is noticed and found again"),
        "fast_odometry": Parameter(FLAG, "brightness is registered at the finest level alone"),
        "frame_to_frame_rgb": Parameter(
            FLAG, "brightness is compared with the last frame instead of the model"
        ),
        "time_window": Parameter(
            (30, 40, 50, 60, 80, 100, 130, 160, 200, 250, 300, 400),
            "what was not seen for so long is inactive",
            "frames",
        ),
        "compute_size_ratio": Parameter(
            (1, 2, 4, 8), "every n-th pixel of depth and colour is used, across and down"
        ),
    },
    stages={
        "preprocessing": "depth to metres up to depth_cutoff and colour, both sampled by compute_size_ratio; "
        "a bilateral filter, normals",
        "tracking": "the camera's pose by depth and colour against the map, after alignment by rotation",
        "integration": "closing loops, fusing the frame into the map, removing surfels",
        "raycasting": "the map as the camera sees it (by splatting), keyframes",
    },
    unattempted="the first frame that measures anything makes the map",
    revises=True,
    packages={"opencv-python-headless": "cv2", "scipy": "scipy"},
)
