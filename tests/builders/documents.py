"""Documents that tests send or publish. All figures in them are made up for testing."""

import hashlib
import json
import uuid
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.datasets.formats.pack import Pack
from wire.protocol import VERSION

FRAMES = 100
PAIRS = 2  # of default and best in a small session: too few for its own interval
DEFAULT_SECONDS = 0.08
STANDARD = {
    "volume_resolution": 256,
    "mu": 0.1,
    "pyramid_iterations_fine": 10,
    "pyramid_iterations_middle": 5,
    "pyramid_iterations_coarse": 4,
    "compute_size_ratio": 2,
    "tracking_rate": 1,
    "icp_threshold": 1e-5,
    "integration_rate": 2,
}
# In metres: how far positions may be from the reference, and how far those of a run are.
BAND, DEVIATION = 0.003, 0.0005
EMPTY_FRAME_US = 250
STAGES = {"preprocessing": 0.1, "tracking": 0.2, "integration": 0.2, "raycasting": 0.5}


def write_pack(
    folder: Path, name: str = "test-sequence", chunks: tuple[bytes, ...] = (b"one", b"two")
) -> dict[str, Any]:
    """A pack whose chunks are those bytes, below `folder`; its pack.json."""
    pack = folder / name
    (pack / "chunks").mkdir(parents=True)
    digests = [hashlib.sha256(content).hexdigest() for content in chunks]
    for digest, content in zip(digests, chunks, strict=True):
        (pack / "chunks" / digest).write_bytes(content)
    description = {
        "name": name,
        "sha256": hashlib.sha256("".join(f"{digest}\n" for digest in digests).encode()).hexdigest(),
        "width": 640,
        "height": 480,
        "frames": FRAMES,
        "volume_size": 5.0,
        "initial_position": [0.5, 0.5, 0.1],
        "chunks": [
            {"sha256": digest, "bytes": len(content)} for digest, content in zip(digests, chunks, strict=True)
        ],
    }
    (pack / "pack.json").write_text(json.dumps(description))
    return description


def front_document(
    pack: dict[str, Any], version: str = "test", *, pairs: int = PAIRS, **changes: Any
) -> dict[str, Any]:
    """A small front that clients can measure, of KinectFusion on `pack`: default, best and a third point."""
    frames = pack.get("frames", FRAMES)
    best = STANDARD | {"compute_size_ratio": 4, "volume_resolution": 128, "integration_rate": 20}
    document = {
        "application": "kfusion",
        "version": version,
        "protocol": {
            "version": VERSION,
            "warmup_frames": 10,
            "frames": frames,
            "first_counted_frame": 10,
            "order": ["default", "best", "best", "default"],
            "repeats": pairs,
            "rest_seconds": 0,
            "max_ate": 0.05,
        },
        "sequence": {"name": pack["name"], "sha256": pack["sha256"]},
        "configurations": [
            {
                "name": "default",
                "parameters": STANDARD,
                "predicted": {"runtime": DEFAULT_SECONDS, "ate_max": 0.01, "ate_mean": 0.005},
            },
            {
                "name": "best",
                "parameters": best,
                "predicted": {"runtime": 0.01, "ate_max": 0.04, "ate_mean": 0.02},
            },
            {
                "name": "accurate",
                "parameters": STANDARD | {"compute_size_ratio": 1},
                "predicted": {"runtime": 0.2, "ate_max": 0.008, "ate_mean": 0.004},
            },
        ],
        "provenance": {"note": "made up for testing", "evaluations": 0},
    }
    document |= changes
    for kind in document.keys() & {"configurations", "probes"}:
        document[kind] = [prepared(point, place, frames) for place, point in enumerate(document[kind])]
    return document


def adaptive_front_document(
    pack: dict[str, Any], version: str = "test", skipped: float = 0.6
) -> dict[str, Any]:
    """The same front with a point `adaptive` that left out `skipped` of the frames on the reference."""
    document = front_document(pack, version)
    default, best, accurate = document["configurations"]
    parameters = best["parameters"] | {"integration_rate": 1, "skip_limit": 3, "skip_translation": 0.05}
    point = {"name": "adaptive", "parameters": parameters | {"skip_rotation": 0.03}, "skipped": skipped}
    point |= {"predicted": {"runtime": 0.004, "ate_max": 0.042, "ate_mean": 0.02}}
    document["configurations"] = [default, best, prepared(point, 3, pack.get("frames")), accurate]
    document["protocol"]["order"] = ["default", "best", "adaptive", "adaptive", "best", "default"]
    return document


def elastic_front_document(sequence: Path, version: str = "test") -> dict[str, Any]:
    """A small front that clients can measure, of ElasticFusion on the pack with colour at `sequence`."""
    pack = Pack(sequence)
    assert pack.colour_manifest is not None
    named = {"name": pack.name, "sha256": pack.sha256, "colour_sha256": pack.colour_manifest["sha256"]}
    predicted = {"runtime": DEFAULT_SECONDS, "ate_max": 0.01, "ate_mean": 0.005}
    points = [
        {"name": name, "parameters": parameters, "predicted": predicted}
        for name, parameters in (
            ("default", {"icp_weight": 10, "fast_odometry": False}),
            ("best", {"icp_weight": 100, "fast_odometry": True}),
        )
    ]
    changes = {"application": "elasticfusion", "sequence": named, "configurations": points}
    return front_document(named | {"frames": len(pack)}, version, **changes)


def prepared(point: dict[str, Any], place: int = 0, frames: int | None = None) -> dict[str, Any]:
    """`point` with what a preparation adds, unless it has it; its trajectory is the one of that `place`."""
    ratio = (point["predicted"]["runtime"] or DEFAULT_SECONDS) / DEFAULT_SECONDS
    times = {
        "runtime_ratio": ratio,
        "low": 0.97 * ratio,
        "high": 1.03 * ratio,
        "rounds": 6,
        "stages": {stage: share * ratio for stage, share in STAGES.items()},
    }
    predicted = {"on_sequence": times} | point["predicted"]
    return {"band": BAND, "trajectory": trajectory(0.001 * place, frames)} | point | {"predicted": predicted}


def predict(point: dict[str, Any], **figures: float | None) -> None:
    """Change the predicted `figures` of `point`, and the times on the sequence with them."""
    without = {name: value for name, value in point["predicted"].items() if name != "on_sequence"}
    point["predicted"] = prepared(point | {"predicted": without | figures})["predicted"]


def trajectory(beside: float = 0.0, frames: int | None = None) -> list[list[float]]:
    """The reference positions of each frame, that many metres `beside` a straight line."""
    return [[0.01 * frame, 0.5 + beside, 0.1] for frame in range(frames or FRAMES)]


def beside_truth(truth: NDArray[np.float64], beside: float = 0.0) -> list[list[float]]:
    """Reference positions whose errors are those of `run_document`, `beside` metres from where others start.

    `truth`: the true poses (frames, 4, 4). Of two errors that its frames have, about one half has each.
    """
    errors = np.where(np.arange(len(truth)) % 2, 0.012, 0.00375)
    errors[0] = 0.0
    exact = (truth[:, :3, 3] - truth[0, :3, 3]) @ truth[0, :3, :3]
    positions = exact + errors[:, None] * [1.0, 0.0, 0.0] + [0.0, beside, 0.0]
    aside: list[list[float]] = positions.round(6).tolist()
    return aside


def run_document(
    configuration: str,
    repeat: int,
    order: int,
    frame_us: int,
    /,
    **changes: Any,
) -> dict[str, Any]:
    """A run whose frames all take `frame_us` microseconds, and whose trajectory is good."""
    return {
        "id": str(uuid.uuid4()),
        "configuration": configuration,
        "repeat": repeat,
        "order": order,
        "status": "ok",
        "failure": None,
        "frame_us": [frame_us] * FRAMES,
        "stages_us": {name: [int(frame_us * share)] * FRAMES for name, share in STAGES.items()},
        "tracked": [None] * 4 + [True] * (FRAMES - 4),
        "ate_max": 0.012,
        "ate_mean": 0.008,
        "ate_rmse": 0.009,
        "deviation": DEVIATION,
    } | changes


def session_document(
    front: str = "kfusion-test",
    default_us: int = 80_000,
    best_us: int = 10_000,
    *,
    pairs: int = PAIRS,
    **changes: Any,
) -> dict[str, Any]:
    """`pairs` (even) of default and best: a session whose speedup is default_us / best_us."""
    times = {"default": default_us, "best": best_us}
    names = ["default", "best", "best", "default"] * (pairs // 2)
    return {
        "id": str(uuid.uuid4()),
        "started_at": "2026-11-20T10:17:00Z",
        "application": "kfusion",
        "front_version": front,
        "protocol_version": VERSION,
        "backend": "opencl",
        "empty_frame_us": EMPTY_FRAME_US,
        "stage_clock": "wall",
        "samples": [{"t": 0.0, "temperature_c": 41.5, "cpu_mhz": 2400.0, "battery": None}],
        "runs": [
            run_document(name, names[:order].count(name), order, times[name])
            for order, name in enumerate(names)
        ],
    } | changes


def device_document(model: str = "Pixel 8", **changes: Any) -> dict[str, Any]:
    """What a phone says of itself."""
    return {
        "os": "Android",
        "os_version": "16",
        "manufacturer": "Google",
        "model": model,
        "soc_manufacturer": "Google",
        "soc_model": "Tensor G3",
        "cpu": None,
        "opencl_platform": "ARM Platform",
        "opencl_device": "Mali-G715",
        "opencl_driver": "3.0 v1.r44p1",
    } | changes


def browser_document(os: str | None = "Android", **changes: Any) -> dict[str, Any]:
    """What a browser says of the device that it runs on."""
    return {
        "os": os,
        "os_version": "16",
        "manufacturer": None,
        "model": "SM-S918B",
        "model_source": "browser",
        "architecture": "arm",
        "cpu_count": "8",
        "memory_gib": "8",
        "gpu_vendor": "qualcomm",
        "gpu_architecture": "adreno-7xx",
        "gpu_device": "",
        "gpu_description": "",
        "browser": "Chrome",
        "browser_version": "149.0.7600.4",
    } | changes


def wasm_session(**changes: Any) -> dict[str, Any]:
    """A session that computed with WebAssembly on two threads."""
    return session_document(**{"backend": "wasm", "threads": 2} | changes)


def submission_document(*sessions: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A whole request body; one ordinary session unless `sessions` are given."""
    return {
        "schema_version": 1,
        "app_version": "0.1.0",
        "consent_version": 2,
        "device": device_document(),
        "sessions": list(sessions) or [session_document()],
    } | changes
