"""KinectFusion, without a device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slam.kfusion.configuration import ANDROID_APP, MOST_SKIPPED, OPTIONAL, Configuration
from slam.system import Definition, Parameter

if TYPE_CHECKING:
    from slam.devices.layout import Layout
    from slam.plans.plan import Plan
    from slam.system import Scene

# Golden vectors: `slam.kfusion.vectors` writes them.
VECTORS = Path(__file__).parent / "kernels" / "vectors.json.gz"
TRIED = Configuration(integration_rate=1, volume_resolution=128)


def _plan(values: Mapping[str, Any], scene: Scene, layout: Layout) -> Plan:
    from slam.kfusion.plan import plan  # commands that run nothing do without it

    return plan(Configuration.from_mapping(values), scene, layout)


def _warm_up(values: Mapping[str, Any]) -> dict[str, Any]:
    """A skip limit launches the kernels that adapt; thresholds of 0 leave no frame out."""
    wanted = Configuration.from_mapping(values)
    kept = {"skip_limit": int(wanted.adapts), "raycast_after_fusion": wanted.raycast_after_fusion}
    return replace(TRIED, **kept).to_dict()


KFUSION = Definition(
    title="KinectFusion",
    complete=lambda values: Configuration.from_mapping(values).to_dict(),
    backends=("opencl", "webgpu", "wasm"),
    colour=False,
    size_multiple=lambda values: int(values["compute_size_ratio"]),
    warm_up=_warm_up,
    parameters={
        "volume_resolution": Parameter((64, 128, 256, 512), "length of each side of the volume", "voxels"),
        "compute_size_ratio": Parameter(
            (1, 2, 4, 8), "every n-th pixel of the depth image is used, across and down"
        ),
        "mu": Parameter(
            (0.025, 0.05, 0.1, 0.2, 0.3, 0.4), "truncation distance of the signed distance field", "m"
        ),
        "icp_threshold": Parameter(
            (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1),
            "iterations end when the update of the pose is smaller",
            "m and rad",
        ),
        "integration_rate": Parameter((1, 2, 5, 10, 20), "every n-th frame is fused into the volume"),
        "tracking_rate": Parameter((1, 2, 3, 5, 9), "every n-th frame is tracked"),
        "pyramid_iterations_fine": Parameter((2, 4, 6, 8, 10), "most ICP iterations at full size"),
        "pyramid_iterations_middle": Parameter((1, 3, 5, 7, 9), "most ICP iterations at half size"),
        "pyramid_iterations_coarse": Parameter((0, 2, 4, 6, 8), "most ICP iterations at quarter size"),
        "skip_limit": Parameter(
            tuple(range(MOST_SKIPPED + 1)),
            "most frames in a row that are skipped while the camera moves little; 0: none",
        ),
        "skip_translation": Parameter(
            (0, 0.02, 0.03, 0.05, 0.08), "a frame is skipped only below this movement", "m"
        ),
        "skip_rotation": Parameter(
            (0, 0.01, 0.02, 0.03, 0.05), "a frame is skipped only below this turn", "rad"
        ),
        "integrate_translation": Parameter(
            (0, 0.02, 0.05, 0.1),
            "a frame is fused when the camera is this far from the last fused one; both 0: integration_rate "
            "decides",
            "m",
        ),
        "integrate_rotation": Parameter(
            (0, 0.02, 0.05, 0.1),
            "a frame is fused when the camera has turned this far from the last fused one; both 0: "
            "integration_rate decides",
            "rad",
        ),
        "raycast_after_fusion": Parameter(
            (0, 1), "1: rays are cast only after a frame that may be fused; 0: after every frame"
        ),
    },
    stages={
        "preprocessing": "depth to metres, sampled by compute_size_ratio, and filtered (bilateral)",
        "tracking": "the camera's pose by ICP against the model, with the pyramid that it needs",
        "integration": "fusing depth into the volume; 0 in frames that integration_rate leaves out",
        "raycasting": "the model as the camera sees it, which the next frame is tracked against",
    },
    optional=OPTIONAL,
    unattempted="the first frames build the model, and tracking_rate leaves frames out",
    skips=lambda values: values.get("skip_limit", 0) > 0,
    plan=_plan,
    known={name: configuration.to_dict() for name, configuration in ANDROID_APP.items()},
)
