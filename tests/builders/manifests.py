"""Documents of the interface, as small as they can be."""

import hashlib
import json
import uuid
from typing import Any

from wire.protocol import VERSION

SERVER = "https://frontrunner.example"
BAND = 0.003
FRAMES = 12


def manifest(chunks: tuple[bytes, ...] = (b"header", b"frames"), **changes: Any) -> dict[str, Any]:
    """A manifest whose sequence consists of these chunks."""
    described: list[dict[str, Any]] = [
        {"sha256": digest(chunk), "bytes": len(chunk), "url": f"/sequences/{digest(chunk)}"}
        for chunk in chunks
    ]
    document = {
        "application": "kfusion",
        "front_version": "1",
        "configurations": [
            configuration("default", {"mu": 0.1}, point(0.100, 0.010)),
            configuration("best", {"mu": 0.4}, point(0.010, 0.040)),
            configuration("fine", {"mu": 0.2}, point(0.050, 0.008)),
        ],
        "protocol": {
            "version": VERSION,
            "warmup_frames": 2,
            "frames": FRAMES,
            "first_counted_frame": 4,
            "order": ["default", "best", "best", "default"],
            "repeats": 2,
            "rest_seconds": 0,
        },
        "sequence": {
            "name": "two chunks",
            "sha256": hashlib.sha256("".join(c["sha256"] + "\n" for c in described).encode()).hexdigest(),
            "width": 64,
            "height": 48,
            "frames": FRAMES,
            "volume_size": 4.8,
            "initial_position": [0.5, 0.5, 0.5],
            "chunks": described,
            "colour": None,
        },
        "consent_version": 2,
        "minimum_app_version": "0.1.0",
        "accepting": True,
        "message": None,
    }
    return {**document, **changes}


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


# A reference trajectory of a camera that stands still, in the middle of the room.
TRAJECTORY = json.dumps([[2.4, 2.4, 0.5]] * FRAMES).encode()


def configuration(
    name: str, parameters: dict[str, Any], predicted: dict[str, float] | None = None, **changes: Any
) -> dict[str, Any]:
    """A configuration of a manifest; its reference trajectory is TRAJECTORY."""
    known = {"parameters": parameters, "predicted": predicted or point(0.1, 0.01), "band": BAND}
    return {"name": name, **known, "trajectory": reference(TRAJECTORY), **changes}


def reference(trajectory: bytes) -> dict[str, str]:
    """Where a manifest says that `trajectory` is."""
    return {"sha256": digest(trajectory), "url": f"/trajectories/{digest(trajectory)}"}


def point(runtime: float, ate_max: float) -> dict[str, float]:
    return {"runtime": runtime, "ate_max": ate_max, "ate_mean": ate_max / 2}


def payload(**changes: Any) -> dict[str, Any]:
    """A submission of one session with one run."""
    run = {"id": str(uuid.uuid4()), "configuration": "default", "status": "ok", "frame_us": [1000] * 12}
    session = {
        "id": str(uuid.uuid4()),
        "application": "kfusion",
        "front_version": "1",
        "runs": [run],
        **changes,
    }
    device = {"opencl_device": "a GPU", "opencl_platform": "a platform"}
    return {"schema_version": 1, "consent_version": 1, "device": device, "sessions": [session]}


def lease(**changes: Any) -> dict[str, Any]:
    """A lease of one configuration of KinectFusion, without sequences."""
    return {
        "id": "5-1",
        "application": "kfusion",
        "configuration": {"volume_resolution": 64},
        "frames": 11,
        "backend": "opencl",
        "opencl_device": "GPU",
        "sequences": [],
        "perturbation": 0,
        "stop_above": [],
        "stop_after": 1,
        "learned_on": 1,
        "objectives": ["ate_max", "runtime"],
        "maximised": [],
        "feasible": None,
        "lease_seconds": 90,
        "heartbeat_seconds": 15.0,
        "timeout_seconds": 900,
        "grace_seconds": 0,
        **changes,
    }
