"""The steps of KinectFusion in each frame, as data: the only place that knows their order.

Frame 0 is the first in which anything was measured (`farthest` is above 0): until then a driver runs frame 0
again for each image, which changes neither volume nor pose. Frames 0 to 3 are integrated where the camera
starts. The first raycast follows frame 3, so frame 4 is the first that can be tracked. A lost frame keeps the
last pose and is not integrated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, replace
from itertools import pairwise

from slam.camera import Camera
from slam.configuration import ConfigurationError
from slam.datasets.sequence import LARGEST_VOLUME
from slam.dense.images import cameras_of
from slam.devices.layout import SOLVERS, SUM_GROUP, SUMS, Layout
from slam.kfusion import configuration as constants
from slam.kfusion.configuration import FRAMES_WITHOUT_TRACKING, LEVELS, Configuration
from slam.kfusion.declarations import (
    ADAPTIVE_KERNELS,
    ADAPTIVE_MEMBERS,
    BLOCK,
    MEMBERS,
    SCALE,
    TILE,
    VIEW_KERNELS,
    WHILE_ITERATING,
    WHILE_RETRYING,
    constants_of,
    kernels_of,
)
from slam.plans.plan import STATE, Buffer, Dispatch, Frames, Plan, Skipping, Value
from slam.system import Scene

NEAR_SURFACE = 0.8 * SCALE  # below this a ray takes small steps
FARTHEST_MEASURED = 65535  # millimetres that 16 bits can say
# A ray advances by at least this part of a voxel, however small mu is: each ray comes to its end.
LEAST_STEP = 1 / 16
# Pixels up to which one work-item tracks an image, by rows: launches for each iteration would take longer.
SMALL_IMAGE = 8192
UNLIMITED = 1e6  # metres or radians: where one of two thresholds is 0, the other decides alone
EMPTY = SCALE | SCALE << 16  # two distances of empty space, of a voxel and of its neighbour


def plan(configuration: Configuration, scene: Scene, layout: Layout) -> Plan:
    """The plan of one frame for `configuration` in `scene`, for kernels laid out by `layout`.

    Layouts differ in buffers, sizes and the format of a voxel, never in order, conditions or constants.
    Raises ConfigurationError where the images cannot be divided by the compute size ratio, or no volume is
    left.
    """
    camera, keeps_view = _camera(configuration, scene), bool(configuration.raycast_after_fusion)
    adapts = configuration.adapts or keeps_view
    return Plan(
        system="kfusion",
        layout=layout.kind,
        configuration=configuration.to_dict(),
        scene=asdict(scene),
        constants=constants_of(layout),
        state=MEMBERS + (ADAPTIVE_MEMBERS if adapts else ()),
        initial=_initial(configuration, scene),
        buffers=_buffers(configuration, scene, layout, cameras_of(camera, LEVELS)),
        kernels=(
            *kernels_of(layout),
            *(ADAPTIVE_KERNELS if adapts else ()),
            *(VIEW_KERNELS if keeps_view else ()),
        ),
        dispatches=(
            *_preprocessing(scene, configuration, camera, layout),
            *_tracking(configuration, scene, cameras_of(camera, LEVELS), layout),
            *_integration(configuration, scene, camera, layout),
            *_raycasting(configuration, scene, camera, layout),
        ),
        input="millimetres",
        skipping=Skipping("skip", "ahead", "pose") if configuration.skip_limit else None,
    )


def _camera(configuration: Configuration, scene: Scene) -> Camera:
    ratio = configuration.compute_size_ratio
    try:
        camera = scene.camera.scaled(ratio)
    except ValueError as error:
        raise ConfigurationError(f"compute_size_ratio={ratio}: {error}") from error
    if min(camera.width, camera.height) < 2 ** (LEVELS - 1):
        raise ConfigurationError(
            f"compute_size_ratio={ratio}: leaves {camera.width}x{camera.height} pixels, "
            f"too few for {LEVELS} levels"
        )
    if not 0 < scene.volume_size <= LARGEST_VOLUME:
        raise ConfigurationError(
            f"volume_size={scene.volume_size}: must be above 0 and at most {LARGEST_VOLUME:g} (metres)"
        )
    return camera


def _initial(configuration: Configuration, scene: Scene) -> dict[str, tuple[int | float, ...]]:
    x, y, z = (fraction * scene.volume_size for fraction in scene.initial_position)
    # Frames 0 to 3 are not checked: the first check that is made allows for the motion since frame 0.
    misses = math.ceil(FRAMES_WITHOUT_TRACKING / configuration.tracking_rate) - 1
    initial = {"pose": (1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, y, 0.0, 0.0, 1.0, z), "misses": (misses,)}
    return initial | ({"elapsed": (misses,), "fusing": (1,)} if configuration.adapts else {})


def _buffers(
    configuration: Configuration, scene: Scene, layout: Layout, cameras: list[Camera]
) -> tuple[Buffer, ...]:
    finest = cameras[0]
    pixels = finest.width * finest.height
    resolution, blocks = configuration.volume_resolution, blocks_of(configuration.volume_resolution)
    most, _, _ = layout.sums(finest.width, finest.height)
    levels = [
        Buffer(f"{name}_{level}", "f32", camera.width * camera.height, planes)
        for level, camera in enumerate(cameras)
        for name, planes in (("filtered", 1), ("normals", 3))
    ]
    if layout.pixels:
        volume = [Buffer("voxels", "u32", resolution**3)]
    else:
        volume = [Buffer("voxels", "u32", resolution**3, fill=EMPTY), Buffer("weights", "u8", resolution**3)]
    return (
        Buffer("state", STATE, 1),
        Buffer("millimetres", "u16", scene.camera.width * scene.camera.height),
        Buffer("depth", "f32", pixels),
        Buffer("row_farthest", "f32", finest.height),
        *([] if layout.pixels else [Buffer("tile_farthest", "f32", _tiles(finest))]),
        *levels,
        Buffer("model_vertices", "f32", pixels, 3),
        Buffer("model_normals", "f32", pixels, 3),
        Buffer("records", "f32", SUMS * most),
        *volume,
        Buffer("surface", "i32", blocks**3),
        Buffer("searched", "i32", blocks**3),
    )


def _preprocessing(
    scene: Scene, configuration: Configuration, camera: Camera, layout: Layout
) -> list[Dispatch]:
    width, height = camera.width, camera.height
    size, group = layout.over(width, height)
    tiles: dict[str, Value] = {} if layout.pixels else {"tile_farthest": "tile_farthest"}
    spatial, range_ = constants.BILATERAL_SPATIAL_SIGMA, constants.BILATERAL_RANGE_SIGMA

    def launch(kernel: str, size: tuple[int, ...], group: tuple[int, ...], /, **arguments: Value) -> Dispatch:
        return Dispatch(kernel, "preprocessing", size, group, arguments)

    return [
        launch(
            "millimetres_to_metres", size, group, millimetres="millimetres", sensor_width=scene.camera.width,
            ratio=configuration.compute_size_ratio, nearest=0, farthest=FARTHEST_MEASURED, metres="depth",
            width=width, height=height,
        ),
        launch(
            "farthest_of_rows", *layout.lines(height), metres="depth", width=width, height=height,
            row_farthest="row_farthest", **tiles,
        ),
        launch("farthest_depth", *layout.one_group(SUM_GROUP), row_farthest="row_farthest", height=height,
               state="state"),
        launch(
            "bilateral_filter", size, group, depth="depth", filtered="filtered_0", width=width, height=height,
            spatial_factor=0.5 / spatial**2, range_factor=0.5 / range_**2,
        ),
    ]  # fmt: skip


def _tracking(
    configuration: Configuration, scene: Scene, cameras: list[Camera], layout: Layout
) -> list[Dispatch]:
    frames = Frames(first=FRAMES_WITHOUT_TRACKING, every=configuration.tracking_rate)
    # The second attempt is launched only after a refusal: a frame that tracks pays nothing for it.
    again = replace(frames, after="refusal")
    patient = map(max, configuration.iterations, constants.RETRY_ITERATIONS)
    one = layout.one_group(1)
    finest = cameras[0]

    def launch(kernel: str, size: tuple[int, ...], group: tuple[int, ...], /, **arguments: Value) -> Dispatch:
        return Dispatch(kernel, "tracking", size, group, arguments, (frames,))

    return [
        *(
            launch(
                "half_sample", *layout.over(coarse.width, coarse.height), fine=f"filtered_{level}",
                fine_width=fine.width, coarse=f"filtered_{level + 1}", width=coarse.width,
                height=coarse.height, range=constants.HALF_SAMPLE_RANGE,
            )
            for level, (fine, coarse) in enumerate(pairwise(cameras))
        ),
        *(
            launch(
                "normal_map", *layout.over(camera.width, camera.height), depth=f"filtered_{level}",
                normals=f"normals_{level}", width=camera.width, height=camera.height,
                camera=_intrinsics(camera),
            )
            for level, camera in enumerate(cameras)
        ),
        launch(
            "begin_at_view", *one, most_extrapolated=constants.MOST_EXTRAPOLATED, state="state",
        ) if configuration.raycast_after_fusion else launch(
            "begin_tracking", *one, camera=_intrinsics(finest),
            most_extrapolated=constants.MOST_EXTRAPOLATED, state="state",
        ),
        *([launch(
            "predict", *one, most_extrapolated=constants.MOST_EXTRAPOLATED, state="state",
        )] if configuration.adapts else []),
        *_attempt(configuration, configuration.iterations, scene, cameras, layout, frames),
        Dispatch("begin_retry", "tracking", *one, {
            "search_after": constants.SEARCH_AFTER, "search_angle": constants.SEARCH_ANGLE, "state": "state",
        }, (again,)),
        *_attempt(configuration, patient, scene, cameras, layout, again, retrying=True),
        *([launch("adapt", *one, **_adapting(configuration))] if configuration.adapts else []),
    ]  # fmt: skip


def _adapting(configuration: Configuration) -> dict[str, Value]:
    return {
        "skip_limit": configuration.skip_limit,
        "skip_translation": configuration.skip_translation,
        "skip_rotation": configuration.skip_rotation,
        "integrate_translation": configuration.integrate_translation or UNLIMITED,
        "integrate_rotation": configuration.integrate_rotation or UNLIMITED,
        "kept_inliers": constants.SKIPPING_INLIERS,
        "decay": constants.SHARE_DECAY,
        "cautious": constants.CAUTIOUS_FRAMES,
        "early": constants.EARLY_FRAMES,
        "state": "state",
    }


def _attempt(
    configuration: Configuration,
    iterations: Iterable[int],
    scene: Scene,
    cameras: list[Camera],
    layout: Layout,
    frames: Frames,
    retrying: bool = False,
) -> list[Dispatch]:
    """ICP from coarse to fine, and the check of its pose."""
    finest = cameras[0]
    first, rest = (WHILE_RETRYING, WHILE_RETRYING | WHILE_ITERATING) if retrying else (0, WHILE_ITERATING)
    flags = {0: None, WHILE_RETRYING: "retrying"}
    dispatches = []

    def launch(
        kernel: str, size: tuple[int, ...], group: tuple[int, ...], conditional: int, /, **arguments: Value
    ) -> None:
        flag = flags.get(conditional, "iterating")
        arguments = {**arguments, "conditional": conditional, "state": "state"}
        dispatches.append(Dispatch(kernel, "tracking", size, group, arguments, (frames,), flag))

    last = finest
    ended: dict[str, Value] = {"threshold": configuration.icp_threshold, "prior": constants.MOTION_PRIOR}
    for level, number in reversed(list(enumerate(iterations))):
        camera = cameras[level]
        count, size, group = layout.sums(camera.width, camera.height)
        tracked: dict[str, Value] = {
            "depth": f"filtered_{level}", "normals": f"normals_{level}", "width": camera.width,
            "height": camera.height, "camera": _intrinsics(camera), "model_vertices": "model_vertices",
            "model_normals": "model_normals", "model_width": finest.width, "model_height": finest.height,
            "max_distance": constants.ASSOCIATION_DISTANCE, "min_dot": constants.ASSOCIATION_NORMAL,
            "records": "records",
        }  # fmt: skip
        last = camera if number else last
        if number and not layout.pixels and camera.width * camera.height <= SMALL_IMAGE:
            launch("iterate", *layout.one_group(1), first, iterations=number, **tracked, **ended)
            continue
        for iteration in range(number):
            conditional = rest if iteration else first
            launch("track", size, group, conditional, **tracked)
            launch("solve", *layout.one_group(SOLVERS), conditional, records="records", count=count, **ended)
    launch(
        "check_pose", *layout.one_group(1), first, pixels=last.width * last.height,
        max_residual=constants.MAX_RESIDUAL, min_inliers=constants.MIN_INLIERS,
        near_motion=constants.NEAR_MOTION, far_inliers=constants.FAR_INLIERS,
        kept_inliers=constants.KEPT_INLIERS, kept_agreement=constants.KEPT_AGREEMENT,
        max_translation=constants.MAX_TRANSLATION * configuration.tracking_rate,
        max_rotation=constants.MAX_ROTATION * configuration.tracking_rate, volume_size=scene.volume_size,
        recovery=constants.RECOVERY_CHECKS,
    )  # fmt: skip
    return dispatches


def _fused(configuration: Configuration) -> tuple[Frames, ...]:
    """The frames that are fused if they are tracked: those chosen by motion or by number, and those of a
    camera that recovers, which sees what the model does not hold yet."""
    first = FRAMES_WITHOUT_TRACKING
    chosen = (
        Frames(first=first, every=configuration.tracking_rate, after="fusing")
        if configuration.integrates_by_motion
        else Frames(first=first, every=configuration.integration_rate)
    )
    return chosen, Frames(first=first, after="recovering")


def _integration(
    configuration: Configuration, scene: Scene, camera: Camera, layout: Layout
) -> list[Dispatch]:
    resolution, blocks = configuration.volume_resolution, blocks_of(configuration.volume_resolution)
    weights: dict[str, Value] = (
        {} if layout.pixels else {"weights": "weights", "tile_farthest": "tile_farthest"}
    )
    columns = layout.over(resolution, resolution) if layout.pixels else ((blocks, blocks), (1, 1))
    return [
        dispatch
        for frames, flag, conditional in (
            ((Frames(last=FRAMES_WITHOUT_TRACKING - 1),), None, 0),
            (_fused(configuration), "tracked", 1),
        )
        for dispatch in (
            Dispatch("integrate", "integration", *columns, {
                "voxels": "voxels", **weights, "resolution": resolution,
                "voxel_size": scene.volume_size / resolution, "surface": "surface", "blocks": blocks,
                "depth": "depth", "width": camera.width, "height": camera.height,
                "camera": _intrinsics(camera), "mu": configuration.mu, "max_weight": constants.MAX_WEIGHT,
                "near_surface": NEAR_SURFACE, "conditional": conditional, "state": "state",
            }, frames, flag),
            Dispatch("dilate_blocks", "integration", *layout.blocks(blocks), {
                "surface": "surface", "searched": "searched", "blocks": blocks, "conditional": conditional,
                "state": "state",
            }, frames, flag),
        )
    ]  # fmt: skip


def _raycasting(configuration: Configuration, scene: Scene, camera: Camera, layout: Layout) -> list[Dispatch]:
    resolution = configuration.volume_resolution
    voxel_size = scene.volume_size / resolution
    last_built = FRAMES_WITHOUT_TRACKING - 1
    after_fusion = (Frames(first=last_built, last=last_built), *_fused(configuration))
    frames = after_fusion if configuration.raycast_after_fusion else (Frames(first=last_built),)
    raycast = Dispatch("raycast", "raycasting", *layout.over(camera.width, camera.height), {
        "voxels": "voxels", "resolution": resolution, "voxel_size": voxel_size, "searched": "searched",
        "blocks": blocks_of(resolution), "width": camera.width, "height": camera.height,
        "camera": _intrinsics(camera), "near_plane": constants.NEAR_PLANE,
        "far_plane": constants.FAR_PLANE, "small_step": voxel_size,
        "large_step": max(0.75 * configuration.mu, LEAST_STEP * voxel_size),
        "near_surface": NEAR_SURFACE, "state": "state", "vertices": "model_vertices",
        "normals": "model_normals",
    }, frames)  # fmt: skip
    if not configuration.raycast_after_fusion:
        return [raycast]
    keep: dict[str, Value] = {"camera": _intrinsics(camera), "state": "state"}
    return [raycast, Dispatch("keep_view", "raycasting", *layout.one_group(1), keep, frames)]


def _tiles(camera: Camera) -> int:
    """The number of tiles that cover an image."""
    return -(-camera.width // TILE) * -(-camera.height // TILE)


def blocks_of(resolution: int) -> int:
    """Blocks along each side of a volume."""
    return -(-resolution // BLOCK)


def _intrinsics(camera: Camera) -> tuple[float, ...]:
    return (camera.fx, camera.fy, camera.cx, camera.cy)
