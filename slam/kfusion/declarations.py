"""What the kernels of KinectFusion take in every language: parameters, state, constants."""

from __future__ import annotations

from slam.devices.layout import SOLVERS, SUM_GROUP, SUMS, Layout
from slam.kfusion import configuration as constants
from slam.kfusion.refusals import Refusal
from slam.plans.plan import STATE, Kernel, Member, Parameter

SCALE = 32766  # of the stored 16-bit distance: one truncation distance
BLOCK = 8  # voxels along each side of a block
TILE = 16  # pixels along each side of a tile of the depth image
# Bits of a launch's `conditional`.
WHILE_ITERATING, WHILE_RETRYING = 1, 2

MEMBERS = (
    Member("pose", "f32", 12),  # camera to volume, metres; 3x4, row by row
    Member("previous", "f32", 12),  # the pose before this frame's tracking
    Member("view", "f32", 12),  # volume to model pixels: intrinsics times the inverse of the model's pose
    Member("squared_error", "f32"),  # of the level and iteration solved last
    Member("inliers", "f32"),
    Member("iterating", "i32"),  # 0 once the current level needs no further iteration
    Member("tracked", "i32"),  # the last pose check passed
    Member("farthest", "f32"),  # largest depth of the frame, metres
    Member("overlap", "f32"),  # pixels that see the model, inliers or not
    Member("misses", "i32"),  # pose checks that failed since the last one that passed
    Member("last_inliers", "f32"),  # share of the pixels at the last pose check that passed
    Member("last_agreement", "f32"),  # likewise, of the pixels that see the model
    Member("translation", "f32"),  # metres from `previous` to the pose that was checked last
    Member("rotation", "f32"),  # radians, likewise
    Member("refusal", "i32"),  # a `slam.kfusion.refusals.Refusal`; 0: the last pose check passed
    Member("recovering", "i32"),  # checks that must pass until the camera counts as found
    Member("retrying", "i32"),  # this is the second attempt of the frame
    Member("start", "f32", 12),  # the pose from which ICP started
    Member("turn", "f32", 3),  # rotation vector of the last accepted motion, for one check
    Member("normal_matrix", "f32", 21),  # J^T J of the iteration solved last, upper triangle row by row
)

# Those of configurations that adapt.
ADAPTIVE_MEMBERS = (
    Member("skip", "i32"),  # frames that are left out next
    Member("ahead", "f32", 12 * (constants.MOST_SKIPPED + 1)),  # the pose expected in each, and after them
    Member("left_out", "i32"),  # frames that were left out before this one
    Member("elapsed", "i32"),  # frames, or checks by tracking_rate, since the pose that passed its check last
    Member("velocity", "f32", 3),  # metres a frame of the last accepted motion
    Member("last_turn", "f32", 3),  # its rotation vector a frame; `turn` is that of the motion to judge
    Member("most_inliers", "f32"),  # decaying maximum of `last_inliers`
    Member("caution", "i32"),  # tracked frames until some are left out again
    Member("fusing", "i32"),  # the next tracked frame is fused
    Member("fused", "f32", 12),  # the pose of the frame that was fused last
    Member("adapted", "i32"),  # tracked frames so far, up to EARLY_FRAMES
)


def _buffer(name: str, access: str, kind: str = "f32", planes: int = 1) -> Parameter:
    return Parameter(name, kind, access, planes)


def _whole(*names: str) -> tuple[Parameter, ...]:
    return tuple(Parameter(name, "i32") for name in names)


def _real(*names: str) -> tuple[Parameter, ...]:
    return tuple(Parameter(name, "f32") for name in names)


CAMERA = Parameter("camera", "vec4f")  # fx, fy, cx, cy


def kernels_of(layout: Layout) -> tuple[Kernel, ...]:
    """The parameters of each kernel. A word holds a voxel's weight where kernels own pixels; by rows it lies
    apart. By rows integration also knows how far each tile of the image sees.
    """
    weights = () if layout.pixels else (_buffer("weights", "write", "u8"), _buffer("tile_farthest", "read"))
    tiles = () if layout.pixels else (_buffer("tile_farthest", "write"),)
    surface = "atomic" if layout.pixels else "write"
    tracked = (
        _buffer("depth", "read"), _buffer("normals", "read", planes=3), *_whole("width", "height"), CAMERA,
        _buffer("model_vertices", "read", planes=3), _buffer("model_normals", "read", planes=3),
        *_whole("model_width", "model_height"), *_real("max_distance", "min_dot"),
    )  # fmt: skip
    iterate = Kernel("iterate", "tracking", (
        *tracked, *_whole("iterations"), *_real("threshold", "prior"), *_whole("conditional"),
        _buffer("state", "write", STATE), _buffer("records", "write"),
    ))  # fmt: skip
    return (
        Kernel("millimetres_to_metres", "images", (
            _buffer("millimetres", "read", "u16"), *_whole("sensor_width", "ratio", "nearest", "farthest"),
            _buffer("metres", "write"), *_whole("width", "height"),
        )),
        Kernel("farthest_of_rows", "preprocessing", (
            _buffer("metres", "read"), *_whole("width", "height"), _buffer("row_farthest", "write"),
            *tiles,
        )),
        Kernel("farthest_depth", "preprocessing", (
            _buffer("row_farthest", "read"), *_whole("height"), _buffer("state", "write", STATE),
        )),
        Kernel("bilateral_filter", "images", (
            _buffer("depth", "read"), _buffer("filtered", "write"), *_whole("width", "height"),
            *_real("spatial_factor", "range_factor"),
        )),
        Kernel("half_sample", "images", (
            _buffer("fine", "read"), *_whole("fine_width"), _buffer("coarse", "write"),
            *_whole("width", "height"), *_real("range"),
        )),
        Kernel("normal_map", "images", (
            _buffer("depth", "read"), _buffer("normals", "write", planes=3), *_whole("width", "height"),
            CAMERA,
        )),
        Kernel("begin_tracking", "tracking", (
            CAMERA, *_whole("most_extrapolated"), _buffer("state", "write", STATE),
        )),
        Kernel("begin_retry", "tracking", (
            *_whole("search_after"), *_real("search_angle"), _buffer("state", "write", STATE),
        )),
        Kernel("track", "tracking", (
            *tracked, *_whole("conditional"), _buffer("state", "read", STATE), _buffer("records", "write"),
        )),
        Kernel("solve", "tracking", (
            _buffer("records", "read"), *_whole("count"), *_real("threshold", "prior"),
            *_whole("conditional"), _buffer("state", "write", STATE),
        )),
        *(() if layout.pixels else (iterate,)),
        Kernel("check_pose", "tracking", (
            *_whole("pixels"), *_real("max_residual", "min_inliers", "near_motion", "far_inliers",
            "kept_inliers", "kept_agreement", "max_translation", "max_rotation", "volume_size"),
            *_whole("recovery", "conditional"), _buffer("state", "write", STATE),
        )),
        Kernel("integrate", "volume", (
            _buffer("voxels", "write", "u32"), *weights, *_whole("resolution"), *_real("voxel_size"),
            _buffer("surface", surface, "i32"), *_whole("blocks"), _buffer("depth", "read"),
            *_whole("width", "height"), CAMERA, *_real("mu", "max_weight", "near_surface"),
            *_whole("conditional"), _buffer("state", "read", STATE),
        )),
        Kernel("dilate_blocks", "volume", (
            _buffer("surface", "read", "i32"), _buffer("searched", "write", "i32"), *_whole("blocks",
            "conditional"), _buffer("state", "read", STATE),
        )),
        Kernel("raycast", "raycasting", (
            _buffer("voxels", "read", "u32"), *_whole("resolution"), *_real("voxel_size"),
            _buffer("searched", "read", "i32"), *_whole("blocks", "width", "height"), CAMERA,
            *_real("near_plane", "far_plane", "small_step", "large_step", "near_surface"),
            _buffer("state", "read", STATE), _buffer("vertices", "write", planes=3),
            _buffer("normals", "write", planes=3),
        )),
    )  # fmt: skip


# After those of every plan, so that all plans number theirs alike. A plan that has those of the view has the
# adaptive ones and their members, too.
ADAPTIVE_KERNELS = (
    Kernel("predict", "adapting", (*_whole("most_extrapolated"), _buffer("state", "write", STATE))),
    Kernel("adapt", "adapting", (
        *_whole("skip_limit"), *_real("skip_translation", "skip_rotation", "integrate_translation",
        "integrate_rotation", "kept_inliers", "decay"), *_whole("cautious", "early"),
        _buffer("state", "write", STATE),
    )),
)  # fmt: skip
VIEW_KERNELS = (
    Kernel("keep_view", "tracking", (CAMERA, _buffer("state", "write", STATE))),
    Kernel("begin_at_view", "tracking", (*_whole("most_extrapolated"), _buffer("state", "write", STATE))),
)


def constants_of(layout: Layout) -> dict[str, int | float]:
    """The constants that kernels of every language share by name."""
    values: dict[str, int | float] = {
        "BLOCK": BLOCK,
        "TILE": TILE,
        "SCALE": float(SCALE),
        "WHILE_ITERATING": WHILE_ITERATING,
        "WHILE_RETRYING": WHILE_RETRYING,
        **{f"REFUSED_{refusal.name}": refusal.value for refusal in Refusal},
        "SUMS": SUMS,
        "SUM_GROUP": SUM_GROUP,
        "SOLVERS": SOLVERS,
    }
    return values | {"GROUP_X": layout.group[0], "GROUP_Y": layout.group[1]} if layout.pixels else values
