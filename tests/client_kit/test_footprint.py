"""What a participant installs and loads: little, and nothing of the server's side."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import msgspec
import pytest

from client_kit.home import Home
from crowd.results.models import DeviceSpeedup, MeasurementSession
from tests.client_kit import room
from tests.client_kit.counting import Counting
from tests.client_kit.participating.test_with_server import pack, server
from tests.client_kit.scripted import ScriptedServer
from tests.test_installation import Environment
from tests.wheel import OFFLINE

__all__ = ["pack", "server"]

PROJECT = Path(__file__).parents[2]
SERVERS_SIDE = (
    "crowd",
    "cv2",
    "django",
    "joblib",
    "pandas",
    "plotly",
    "requests",
    "scipy",
    "sklearn",
)
OPENCL = {
    "platformdirs",
    "pocl-binary-distribution",
    "pyopencl",
    "pytools",
    "siphash24",
    "typing-extensions",
}
LARGEST_MB = 250  # 165 of them are PoCL's wheel, which a device with its own driver does without

SCRIPT = """\
import json, sys
from client_kit.__main__ import main
code = main(sys.argv[1:])
import client_kit.measuring.worker  # `run` measures in another process, which loads this
print(json.dumps([code, sorted({name.split(".")[0] for name in sys.modules})]))
"""


@pytest.mark.slow
def test_a_whole_run_loads_nothing_of_the_servers_side(
    serve: Callable[..., ScriptedServer], home: Home, tmp_path: Path
) -> None:
    pack = room.write(tmp_path / "room")
    scripted = serve(Counting(room.manifest(pack), tmp_path / "room" / "chunks"))
    environment = {**os.environ, "FRONTRUNNER_HOME": str(home.path)}

    for command in (
        ["run", "--server", scripted.url, "--yes"], ["choose"], ["status"], ["send"], ["erase", "--yes"]
    ):  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, *command],
            cwd=PROJECT,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        code, modules = json.loads(done.stdout.splitlines()[-1])
        assert code == 0, done.stderr
        assert not set(SERVERS_SIDE) & set(modules)
        # Sending and looking need no device: they work where OpenCL is broken.
        assert ("pyopencl" in modules) == (command[0] == "run")


def requirements(names: list[str]) -> set[str]:
    """The distributions that these requirements bring along on this machine, without extras."""
    distributions: set[str] = set()
    for requirement in names:
        name = re.split(r"[^\w.-]", requirement.strip(), maxsplit=1)[0].replace("_", "-").lower()
        if "extra ==" in requirement or name in distributions:
            continue
        try:
            distributions |= {name} | requirements(distribution(name).requires or [])
        except PackageNotFoundError:  # its marker does not hold here, so the lock left it out
            continue
    return distributions


@pytest.mark.parametrize(
    ("extra", "packages", "largest_mb"),
    [("", set(), 85), ("wasm", {"wasmtime"}, 125), ("opencl", OPENCL, LARGEST_MB)],
    ids=["base", "wasm", "opencl"],
)
def test_what_a_device_installs_is_small(extra: str, packages: set[str], largest_mb: int) -> None:
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]

    needed = requirements([*project["dependencies"], *project["optional-dependencies"].get(extra, ())])

    assert needed <= {"msgspec", "numpy", *packages}
    files = [path for name in needed for path in distribution(name).files or [] if path.suffix != ".pyc"]
    size = sum(file.stat().st_size for path in files if (file := Path(str(path.locate()))).is_file())
    assert size < largest_mb * 1e6


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory, wheel: Path) -> Path:
    """The Python of an empty environment into which the wheel, built here, was installed without NumPy."""
    folder = tmp_path_factory.mktemp("wheel")
    venv.create(folder / "empty", with_pip=False)
    python = folder / "empty" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    # Neither step may look for an index: all that they need is here.
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", *OFFLINE, "--no-compile"]
    subprocess.run([*install, str(wheel)], check=True)
    [packages] = (folder / "empty").rglob("site-packages")
    (packages / "msgspec").symlink_to(Path(msgspec.__file__).parent)
    return python


def run_installed(python: Path, home: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [str(python), "-m", "client_kit", *arguments],
        cwd=home,  # not the project: the wheel's own files must do
        env={**os.environ, "FRONTRUNNER_HOME": str(home), "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_an_empty_environment_says_what_to_install(installed: Path, home: Home) -> None:
    version = run_installed(installed, home.path, "--version")
    status = run_installed(installed, home.path, "status")
    run = run_installed(installed, home.path, "run", "--server", "http://127.0.0.1:1")

    assert version.returncode == 0, version.stderr
    assert (status.returncode, status.stdout) == (0, "Nothing was measured here yet.\n")
    assert (run.returncode, run.stderr) == (
        3, "frontrunner: numpy is not installed here: pip install numpy\n",
    )  # fmt: skip


@pytest.mark.slow
def test_the_wheel_beside_numpy_and_pyopencl_is_all_that_a_device_needs(installed: Path, home: Home) -> None:
    # Both from here: no index needs to answer. The client itself is found in its own environment.
    script = "import slam, sys; sys.path.append(sys.argv[1]); print(slam.__path__[0]); "
    script += "sys.argv[1:] = ['doctor']; import runpy; runpy.run_module('client_kit', run_name='__main__')"
    packages = sysconfig.get_path("purelib")

    done = subprocess.run(
        [str(installed), "-c", script, packages],
        cwd=home.path,
        env={**os.environ, "FRONTRUNNER_HOME": str(home.path), "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )

    folder, *lines = done.stdout.splitlines()
    assert Path(folder).is_relative_to(installed.parents[1]), done.stderr
    for part in ("dense", "kfusion"):
        kernels = {path.name for path in (PROJECT / "slam" / part / "kernels").iterdir()}
        assert {path.name for path in (Path(folder) / part / "kernels").iterdir()} == kernels
    assert any(line.startswith("OpenCL device: ") for line in lines), done.stderr
    # Whether it may measure depends on the machine's state; either way it was looked at to the end.
    assert done.returncode == 0 or any(line.startswith("Stop: ") for line in lines), done.stderr


@pytest.mark.slow
def test_with_the_extra_wasm_alone_a_device_enrols_measures_and_its_session_counts(
    wheel: Path, server: str, tmp_path: Path
) -> None:
    alone = Environment(tmp_path, wheel, "wasm")
    opencl = subprocess.run([alone.command[0], "-c", "import pyopencl"], cwd=tmp_path, capture_output=True)
    assert b"ModuleNotFoundError" in opencl.stderr
    examined = alone.run("doctor").stdout
    assert re.search(r"^WebAssembly device: .*, used unless", examined, re.MULTILINE)
    assert "  opencl_device: unknown" in examined

    done = alone.run("measure", "--server", server, "--yes")

    assert done.returncode == 0, done.stdout + done.stderr
    [session] = MeasurementSession.objects.all()
    assert (session.backend, session.stage_clock) == ("wasm", "wall")
    assert session.threads >= 1
    assert [run.status for run in session.runs.all()] == ["ok"] * 4
    [speedup] = DeviceSpeedup.objects.filter(configuration__name="best")
    assert speedup.speedup > 0
    assert f"{server}/devices/{session.device.slug}/" in done.stdout
