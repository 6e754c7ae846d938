"""Golden vectors are enough to check an executor: replayed here, they give what they say."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from slam.devices.choice import choose_device, open_session
from slam.devices.layout import Layout
from slam.kfusion.pipeline import FOLDERS
from slam.kfusion.plan import ADAPTIVE_KERNELS, kernels_of
from slam.plans.executors import prepare
from slam.plans.plan import Plan
from tests.slam.conformance import vectors

HERE = Path(__file__).parent


@pytest.mark.slow
def test_vectors_of_every_kernel_can_be_replayed(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", str(HERE / "test_tracking_kernels.py"),
         str(HERE / "test_volume_kernels.py"), str(HERE / "test_image_kernels.py"),
         str(HERE / "test_adapting_kernels.py")],
        env=os.environ | {"FRONTRUNNER_VECTORS": str(tmp_path)}, check=True, capture_output=True,
    )  # fmt: skip
    session = open_session(choose_device(), Layout("pixels"))
    replayed = set()
    for path in sorted(tmp_path.glob("*.json")):
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        plan = Plan.from_dict(document["plan"])
        execution = prepare(plan, session, FOLDERS)
        for name, values in vectors.decoded(document["inputs"], plan).items():
            execution.write(name, values)
        execution.run(0)
        for name, expected in vectors.decoded(document["outputs"], plan).items():
            assert execution.read(name).tobytes() == expected.tobytes()
        replayed.add(plan.dispatches[0].kernel)
    assert replayed == {kernel.name for kernel in (*kernels_of(session.layout), *ADAPTIVE_KERNELS)}
