"""The client in a Debian for 64-bit ARM, the paper's kind of machine, which qemu emulates.

FRONTRUNNER_ARM64=FOLDER keeps that Debian in FOLDER: it takes 400 MB, and minutes to fetch.
"""

import os
import shutil
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from client_kit.home import Home
from crowd.devices.models import DeviceDescription
from crowd.results.models import MeasurementSession
from tests import wheel
from tests.client_kit import room
from tests.client_kit.participating.test_with_server import pack, server

__all__ = ["pack", "server"]

PROGRAMS = ("debootstrap", "dpkg-deb", "proot", "qemu-aarch64-static")
MIRROR = "http://deb.debian.org/debian"
PACKAGES = ("python3", "pocl-opencl-icd", "ca-certificates")
WHEELS = ("numpy", "pyopencl", "wasmtime==50.*")
LIBRARIES, CLIENT = "opt/libraries", "opt/frontrunner"  # below the root
# The names of wheels for glibc's versions up to Debian 12's.
PLATFORMS = [
    f"--platform={name}_aarch64" for name in ("manylinux2014", *(f"manylinux_2_{n}" for n in range(17, 37)))
]

pytestmark = [pytest.mark.slow, pytest.mark.django_db(transaction=True)]


def fetched(*command: str) -> None:
    """Run what needs a network; the test is skipped where that fails."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        lines = (done.stderr or done.stdout).strip().splitlines() or [""]
        pytest.skip(f"{command[0]} failed: {lines[-1]}")


@pytest.fixture(scope="module")
def debian(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a Debian 12 for arm64, with this client."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}")
    if os.geteuid() != 0:
        pytest.skip("debootstrap runs as root only")
    folder = Path(os.environ.get("FRONTRUNNER_ARM64") or tmp_path_factory.mktemp("arm64")) / "debian"
    if not (folder / "usr/bin/python3").exists():
        kind = ("--arch=arm64", "--variant=minbase", "--foreign", f"--include={','.join(PACKAGES)}")
        fetched("debootstrap", *kind, "bookworm", str(folder), MIRROR)
        # Unpacked is enough: to configure them, which emulation makes slow, changes nothing for the client.
        for package in (folder / "var/cache/apt/archives").glob("*.deb"):
            subprocess.run(["dpkg-deb", "--extract", package, folder], check=True)
    install = (sys.executable, "-m", "pip", "install", "--quiet")
    if not (folder / LIBRARIES).exists():
        made_for = ("--only-binary=:all:", "--python-version=3.11", *PLATFORMS)
        fetched(*install, "--target", str(folder / LIBRARIES), *made_for, *WHEELS)
    shutil.rmtree(folder / CLIENT, ignore_errors=True)
    built = tmp_path_factory.mktemp("wheel")
    (built / "guide").mkdir()
    client = wheel.build(built, built / "guide")
    subprocess.run([*install, "--no-index", "--no-deps", "--target", folder / CLIENT, client], check=True)
    return folder


@pytest.mark.parametrize("backend", ["opencl", "wasm"])
def test_a_session_is_measured_on_64_bit_arm(debian: Path, server: str, home: Home, backend: str) -> None:
    environment = {
        "PATH": "/usr/bin:/bin",
        "HOME": "/root",
        "LANG": "C.UTF-8",
        "PYTHONPATH": f"/{CLIENT}:/{LIBRARIES}",
        "FRONTRUNNER_HOME": str(home.path),
    }
    with urllib.request.urlopen(f"{server}/api/v1/manifest") as answer:
        assert answer.status == 200  # a busy machine plans the frames longer than the client waits
    shared = (option for path in ("/proc", "/dev", "/etc/hosts", home.path) for option in ("-b", path))
    emulated = ("proot", "-q", "qemu-aarch64-static", "-0", "-r", debian, *shared, "-w", "/")
    command = (
        "run",
        "--server",
        server,
        "--yes",
        "--no-probes",
        "--backend",
        backend,
        "--ignore",
        "throttling",
    )
    done = subprocess.run(
        [*emulated, "/usr/bin/python3", "-m", "client_kit", *command],
        env=environment,
        capture_output=True,
        text=True,
    )

    assert done.returncode == 0, done.stdout + done.stderr
    [session] = MeasurementSession.objects.all()
    assert session.backend == backend
    assert [run.status for run in session.runs.all()] == ["ok"] * 4
    assert all(run.deviation < room.BAND for run in session.runs.all())
    raw: dict[str, Any] = DeviceDescription.objects.get().raw
    assert (raw["os"], raw["architecture"]) == ("Linux", "aarch64")
