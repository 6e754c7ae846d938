"""Executed by Deno, the browser's modules give the reference of the front that ships."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.client_kit.web import deno
from tests.shipped import KFUSION, LIVING_ROOM

FRAMES = {"wasm": 40, "webgpu": 6}  # a software adapter takes a second for each that is tracked


@pytest.mark.slow
@pytest.mark.parametrize("backend", FRAMES)
def test_deno_follows_the_reference(backend: str) -> None:
    point = json.loads(KFUSION.read_text(encoding="utf-8"))["configurations"][0]

    positions = deno.execute(point["parameters"], LIVING_ROOM, backend, FRAMES[backend], threads=2).positions

    if not positions:
        pytest.skip("Deno finds no WebGPU adapter here")
    apart = np.linalg.norm(np.array(positions) - np.array(point["trajectory"][: FRAMES[backend]]), axis=1)
    assert len(positions) == FRAMES[backend]
    assert apart.max() < point["band"]
