"""The product by command, with ElasticFusion: explore, prepare, publish, measure, and read the figure."""

import json
import subprocess
import sys
from pathlib import Path

from tests.services import intake
from tests.services.program import ROOT
from tests.services.serving import Serving, each, environment
from tests.slam.tiny import write_tiny_pack

BY_PROCESSOR = {
    "DJANGO_SETTINGS_MODULE": "tests.services.settings",
    "TEST_EVALUATOR": "tests.services.processor_time.measure",
    "FRONTRUNNER_LEASE_SECONDS": "90",
}
# Whatever is drawn from it follows the camera in the tiny pack, and far depths cost a third of the time.
SPACE = {
    "name": "elasticfusion",
    "parameters": [
        {"name": "depth_cutoff", "type": "ordinal", "values": [2.0, 12.0], "default": 12.0},
        {"name": "icp_weight", "type": "ordinal", "values": [10], "default": 10},
    ],
}


def test_what_a_command_explores_and_publishes_the_native_client_measures(tmp_path: Path) -> None:
    var, front, space = tmp_path / "var", tmp_path / "elasticfusion-9.json", tmp_path / "space.json"
    intake.prepare(var, {})
    write_tiny_pack(var / "sequences", colour=True, step=2)
    space.write_text(json.dumps(SPACE))
    wishes = "--sequence tiny --method random --budget 2 --batch 2 --points 2 --repeats 2"

    explored, published = each(
        var,
        f"explore --space {space} {wishes} --out {front}",
        "front publish elasticfusion-9 --yes",
        **BY_PROCESSOR,
    )
    assert explored.returncode == 0, explored.stdout + explored.stderr
    assert "elasticfusion-9: published" in published.stdout, published.stderr

    with Serving(var, {"FRONTRUNNER_RARE_BELOW": "1"}) as server:
        asked = f"run --server {server.url} --application elasticfusion --yes --ignore-battery"
        measured = subprocess.run(
            [sys.executable, "-m", "client_kit", *asked.split()],
            cwd=ROOT,
            env=environment(tmp_path / "client", FRONTRUNNER_HOME=str(tmp_path / "client")),
            capture_output=True,
            text=True,
            check=False,
        )
        assert measured.returncode == 0, measured.stdout + measured.stderr
        status, figures = server.call("GET", "/api/v1/speedups?front=elasticfusion-9")

    assert status == 200
    (row,) = figures["results"]
    assert (row["configuration"], row["backend"]) == ("best", "opencl")
    assert row["speedup"] > 0
