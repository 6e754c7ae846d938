"""The client measures in a Debian for 64-bit ARM, and sends to a server of the tests."""

import shutil
from collections.abc import Iterator
from typing import Any

import pytest

from client_kit.device.preflight import IGNORABLE
from crowd.results.models import MeasurementSession
from slam import benchmark
from slam.datasets.formats.pack import Pack
from tests import arm64
from tests.client_kit import room
from tests.client_kit.participating.test_with_server import pack
from tests.client_kit.published import publish

__all__ = ["pack"]

pytestmark = [pytest.mark.slow, pytest.mark.exhaustive, pytest.mark.django_db(transaction=True)]
MILLIMETRE = 0.001
# One layout of kernels is compiled instead of two: the emulated compiler takes minutes for each.
FASTER = {"OPENBLAS_NUM_THREADS": "1", "FRONTRUNNER_KERNELS": "rows"}
COARSE = {"default": {"volume_resolution": 64, "integration_rate": 1}, "best": room.CONFIGURATIONS["best"]}


@pytest.fixture(scope="module")
def debian(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[arm64.Debian]:
    folder = tmp_path_factory.mktemp("arm64")
    arm64.skip_without_means(folder)
    try:
        yield arm64.make(folder / "debian", request.getfixturevalue("wheel"))
    finally:
        shutil.rmtree(folder)


@pytest.fixture
def server(live_server: Any, settings: Any, pack: Pack) -> str:
    """The address of a server that asks for one run of default and one of best over the room."""
    asked = room.manifest(pack)
    protocol = asked["protocol"] | {"warmup_frames": 0, "order": ["default", "best"], "repeats": 1}
    chosen = [each for each in asked["configurations"] if each["name"] in COARSE]
    publish(settings, pack, protocol, [each | {"parameters": COARSE[each["name"]]} for each in chosen])
    return str(live_server.url)


@pytest.mark.parametrize("backend", ["wasm", "opencl"])
def test_a_session_on_64_bit_arm_has_the_errors_of_this_machine(
    debian: arm64.Debian, server: str, pack: Pack, backend: str
) -> None:
    options = ("--server", server, "--yes", "--no-probes", "--backend", backend)
    measure = (arm64.CLIENT, "-m", "frontrunner", "measure", *options, "--ignore", ",".join(IGNORABLE))
    done = debian.run(*measure, FRONTRUNNER_HOME=f"/root/{backend}", **FASTER)

    assert done.returncode == 0, done.stdout + done.stderr
    [session] = MeasurementSession.objects.all()
    assert session.backend == backend
    raw = session.description.raw
    assert (raw["os"], raw["architecture"]) == ("Debian GNU/Linux", "aarch64")
    runs = session.runs.order_by("order")
    assert [(run.configuration.name, run.status, run.state) for run in runs] == [
        ("default", "ok", "valid"),
        ("best", "ok", "valid"),
    ]
    for run in runs:
        here = benchmark.run(COARSE[run.configuration.name], pack, system="kfusion", backend=backend)
        assert here.ate is not None
        assert run.ate_max == pytest.approx(here.ate.max, abs=MILLIMETRE)
    # One pair in one order is not enough, and qemu may show the name of this machine's processor.
    [summary] = session.summaries.all()
    assert summary.reason in ("emulator", "unbalanced_order")
    assert f"The server sets best aside: suspect, {summary.reason}" in done.stdout
