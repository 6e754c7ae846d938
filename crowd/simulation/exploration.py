"""A simulated search: a made-up reference device answers every lease with made-up measurements."""

import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from crowd.explorations import services
from crowd.explorations.measuring.tokens import issue_token
from crowd.explorations.models import Exploration, ReferenceDevice
from crowd.explorations.space_choice import SPACES
from crowd.simulation.transport import Transport
from groundwork import __version__

DEVICE = "demo-board"
BUDGET, BATCH = 90, 30
LEAST_ERROR, LOST_ABOVE = 0.004, 0.12  # m
NOISE = 0.08  # standard deviation of the logarithms of times and errors


def run_once(transport: Transport, pack: Mapping[str, Any], seed: int) -> None:
    """A finished random search over the sequence `pack`, whose evaluations went through the API of leases.

    An unfinished one is replaced. Raises RefusedError.
    """
    device, _ = ReferenceDevice.objects.get_or_create(name=DEVICE, defaults={"queue": DEVICE})
    earlier = Exploration.objects.filter(reference_device=device)
    if earlier.filter(state=Exploration.State.DONE).exists():
        return
    earlier.delete()
    search = services.create(
        Exploration(
            space=json.loads((SPACES / "kfusion.json").read_text()),
            sequence=pack["name"],
            sequence_sha256=pack["sha256"],
            reference_device=device,
            objectives=["runtime", "ate_max"],
            limits={"ate_max": 0.05},
            method="random",
            seed=seed,
            budget=BUDGET,
            batch=BATCH,
            repeats=0,
        )
    )
    token = issue_token(device)
    _measure_all(transport, token)
    while services.advance(search.pk):
        _measure_all(transport, token)


def _measure_all(transport: Transport, token: str) -> None:
    """Measure until no lease is left."""
    request = {"worker": DEVICE, "lease_version": 2}
    while (response := transport.send("POST", "/leases", request, token)).status == 201:
        lease = response.content
        result = measurement(lease["configuration"]) | {
            "configuration": lease["configuration"],
            "software": f"client_kit {__version__}",
        }
        if result["status"] == "done":
            result["parts"] = [
                {"sequence": pack["name"], "lost": 0, "objectives": result["objectives"]}
                for pack in lease["sequences"]
            ]
        transport.ask(200, "POST", f"/leases/{lease['id']}/result", document=result, token=token)


def measurement(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """What a machine might measure with `configuration` of KinectFusion: errors grow as times shrink."""
    digest = hashlib.sha256(json.dumps(configuration, sort_keys=True).encode()).digest()
    noise = np.random.default_rng(list(digest[:4])).lognormal(0.0, NOISE, 2)
    pixels = 1.0 / configuration["compute_size_ratio"] ** 2
    side = configuration["volume_resolution"] / 256
    fine, middle, coarse = (
        configuration[f"pyramid_iterations_{level}"] for level in ("fine", "middle", "coarse")
    )
    steps = fine + middle / 4 + coarse / 16
    stages = {
        "preprocessing": 0.0008 * pixels,
        "tracking": 0.0003 * pixels * steps / configuration["tracking_rate"],
        "integration": 0.004 * side**3 / configuration["integration_rate"],
        "raycasting": 0.006 * pixels * math.sqrt(side),
    }
    stages = {name: seconds * float(noise[0]) for name, seconds in stages.items()}
    coarseness = (0.5 + 0.5 / side) * configuration["compute_size_ratio"] ** 0.5
    drift = 1.0 + 0.04 * configuration["integration_rate"] + 0.25 * (configuration["tracking_rate"] - 1)
    careless = 1.0 + 20.0 * configuration["icp_threshold"] + 2.0 / steps
    error = LEAST_ERROR * coarseness * drift * careless * float(noise[1])
    if error > LOST_ABOVE:
        return {"status": "failed", "error": "tracking was lost in more than half of the frames"}
    objectives = {"runtime": sum(stages.values()), "ate_max": error, "ate_mean": error / 3}
    device = {"platform": "Demo", "name": "Demo board", "driver": "1.0", "backend": "opencl"}
    return {"status": "done", "objectives": objectives, "stages": stages, "device": device}
