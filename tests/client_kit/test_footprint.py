"""What a participant installs and loads: little, and nothing of the server's side."""

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from client_kit.home import Home
from tests.client_kit import room
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import ScriptedServer

PROJECT = Path(__file__).parents[2]
SERVERS_SIDE = (
    "crowd",
    "cv2",
    "django",
    "joblib",
    "msgspec",
    "pandas",
    "plotly",
    "requests",
    "scipy",
    "sklearn",
)
BASE = {
    "numpy",
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
print(json.dumps([code, sorted({name.split(".")[0] for name in sys.modules})]))
"""


def test_a_whole_run_loads_nothing_of_the_servers_side(
    serve: Callable[..., ScriptedServer], home: Home, tmp_path: Path
) -> None:
    pack = room.write(tmp_path / "room")
    scripted = serve(Counting(room.manifest(pack), tmp_path / "room" / "chunks"))
    environment = {**os.environ, "FRONTRUNNER_HOME": str(home.path)}

    for command in (["run", "--server", scripted.url, "--yes"], ["choose"], ["status"], ["send"], ["erase"]):
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
    found: set[str] = set()
    for requirement in names:
        name = re.split(r"[^\w.-]", requirement.strip(), maxsplit=1)[0].replace("_", "-").lower()
        if "extra ==" in requirement or name in found:
            continue
        try:
            found |= {name} | requirements(distribution(name).requires or [])
        except PackageNotFoundError:  # its marker does not hold here, so the lock left it out
            continue
    return found


def test_the_base_installation_is_small() -> None:
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]

    needed = requirements(project["dependencies"])

    assert needed <= BASE
    files = [path for name in needed for path in distribution(name).files or [] if path.suffix != ".pyc"]
    size = sum(file.stat().st_size for path in files if (file := Path(str(path.locate()))).is_file())
    assert size < LARGEST_MB * 1e6


def test_an_installed_client_has_every_kernel_file() -> None:
    settings = tomllib.loads((PROJECT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    for package, patterns in settings.items():
        folder = PROJECT.joinpath(*package.split("."))
        shipped = {path for pattern in patterns for path in folder.glob(pattern)}
        data = {path for path in folder.rglob("*.*") if path.suffix in (".cl", ".h", ".json")}
        assert data <= shipped
