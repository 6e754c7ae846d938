"""The client measures in a Debian for 64-bit ARM, over a server of the tests."""

import json
import shutil
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from crowd.devices.models import DeviceDescription
from crowd.results.models import MeasurementSession
from slam.datasets.formats.pack import Pack
from tests import arm64
from tests.client_kit import documents, room
from tests.client_kit.participating.test_with_server import pack
from tests.client_kit.published import publish

__all__ = ["pack"]

pytestmark = [pytest.mark.slow, pytest.mark.django_db(transaction=True)]
# One layout of kernels is compiled instead of two, since the emulated compiler takes minutes for each.
FASTER = {"OPENBLAS_NUM_THREADS": "1", "FRONTRUNNER_KERNELS": "rows"}


@pytest.fixture(scope="module")
def debian(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[arm64.Debian]:
    folder = tmp_path_factory.mktemp("arm64")
    arm64.skip_without_means(folder)
    yield arm64.make(folder / "debian", request.getfixturevalue("wheel"))
    shutil.rmtree(folder)


@pytest.fixture
def server(live_server: Any, settings: Any, pack: Pack) -> str:
    """The address of a server that asks for one run of default and one of best over the room."""
    protocol = documents.manifest()["protocol"]
    protocol |= {"warmup_frames": 0, "order": ["default", "best"], "repeats": 1}
    publish(settings, pack, protocol, room.manifest(pack)["configurations"])
    return str(live_server.url)


@pytest.mark.parametrize("backend", ["wasm", "opencl"])
def test_a_session_on_64_bit_arm_has_the_errors_of_other_machines(
    debian: arm64.Debian, server: str, backend: str
) -> None:
    command = ("run", "--server", server, "--yes", "--no-probes", "--backend", backend)
    done = debian.run(arm64.CLIENT, "-m", "frontrunner", "measure", *command, **FASTER)

    assert done.returncode == 0, done.stdout + done.stderr
    [session] = MeasurementSession.objects.all()
    assert session.backend == backend
    raw = DeviceDescription.objects.get().raw
    assert (raw["os"], raw["architecture"]) == ("Debian GNU/Linux", "aarch64")
    runs = session.runs.order_by("position")
    assert [(run.configuration.name, run.status) for run in runs] == [("default", "ok"), ("best", "ok")]
    assert all(run.deviation < room.BAND for run in runs)
    with urllib.request.urlopen(f"{server}/api/v1/sessions/{session.uuid}") as answer:
        print(json.load(answer))
    print(done.stdout)
