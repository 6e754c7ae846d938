"""The wheel in an environment that has what it requires and nothing else: no checkout beside it."""

import os
import re
import signal
import subprocess
import sys
import sysconfig
import urllib.request
import venv
import zipfile
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.services.program import free_port
from tests.shipped import KFUSION
from tests.waiting import until
from tests.wheel import OFFLINE, PACKAGES, PROJECT

SITE = Path(sysconfig.get_path("purelib"))


def link_requirements(distribution: metadata.Distribution, extras: Iterable[str], site: Path) -> None:
    """Put into `site` what `distribution` requires with `extras`, from this environment, and what that
    requires."""
    for text in distribution.requires or ():
        wanted = Requirement(text)
        if wanted.marker is not None and not any(wanted.marker.evaluate({"extra": e}) for e in ("", *extras)):
            continue
        if wanted.name == distribution.name:
            link_requirements(distribution, wanted.extras, site)
            continue
        required = metadata.distribution(wanted.name)
        tops = {file.parts[0] for file in required.files or ()} - {"..", "__pycache__"}
        missing = [top for top in tops if not (site / top).exists()]
        for top in missing:
            (site / top).symlink_to(SITE / top)
        if missing or wanted.extras:
            link_requirements(required, wanted.extras, site)


def test_the_wheel_has_every_tracked_file_of_its_packages(wheel: Path) -> None:
    listed = subprocess.run(["git", "ls-files", *PACKAGES], cwd=PROJECT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout: there is no list of tracked files")
    wanted = {
        f"frontrunner/{name}" if name.startswith("fixtures/") else name
        for name in listed.stdout.splitlines()
        if not name.endswith((".md", ".ts")) and not Path(name).name.startswith("jsconfig")
    }

    assert wanted <= set(zipfile.ZipFile(wheel).namelist())


class Environment:
    """A virtual environment with the wheel, and what its `extras` require."""

    def __init__(self, folder: Path, wheel: Path, *extras: str) -> None:
        venv.create(folder / "venv", with_pip=False)
        site = next((folder / "venv").glob("lib/python*/site-packages"))
        command = [sys.executable, "-m", "pip", "install", *OFFLINE, "--no-compile", "--target", site, wheel]
        subprocess.run(command, check=True, capture_output=True)
        declared = metadata.Distribution.at(next(site.glob("frontrunner-*.dist-info")))
        link_requirements(declared, extras, site)
        self.folder = folder
        self.command = [folder / "venv" / "bin" / "python", "-m", "frontrunner"]
        self.environment = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("FRONTRUNNER_", "DJANGO_"))
        } | {"HOME": str(folder), "XDG_DATA_HOME": str(folder / "data")}

    def run(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [*self.command, *words], cwd=self.folder, env=self.environment, capture_output=True, text=True
        )


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory, wheel: Path) -> Environment:
    return Environment(tmp_path_factory.mktemp("client"), wheel, "opencl")


@pytest.mark.slow
def test_with_opencl_the_base_measures_and_runs_slam_over_a_sequence_of_its_own(client: Environment) -> None:
    version = client.run("--version")
    assert (version.returncode, version.stdout.split()[0]) == (0, "frontrunner")
    ran = client.run("slam", "run", "--frames", "3", "--set", "volume_resolution=64", "--json", "-")
    assert ran.returncode == 0, ran.stderr
    assert '"frames": [' in ran.stdout
    nowhere = client.run("measure", "--server", "http://127.0.0.1:9", "--yes")
    assert nowhere.stderr.startswith("frontrunner: ")
    assert "http://127.0.0.1:9" in nowhere.stderr


def test_the_base_names_what_other_commands_need(client: Environment) -> None:
    assert "explore" in client.run("tune", "--help").stdout
    tune, serve = client.run("tune", "explore", "--help"), client.run("serve")
    assert (tune.returncode, serve.returncode) == (2, 2)
    assert "pip install 'frontrunner[explore]'" in tune.stderr
    assert "pip install 'frontrunner[server]'" in serve.stderr
    assert client.run("sing").returncode == 2


@pytest.mark.slow
def test_a_server_without_a_checkout_serves_pages_static_files_and_fronts(
    tmp_path: Path, wheel: Path
) -> None:
    installed = Environment(tmp_path, wheel, "server")
    port = free_port()
    with (tmp_path / "serve.log").open("w") as log:
        server = subprocess.Popen(
            [*installed.command, "serve", "--port", str(port)],
            cwd=tmp_path, env=installed.environment, stdout=log, stderr=subprocess.STDOUT,
        )  # fmt: skip
    try:
        page = fetch(server, f"http://127.0.0.1:{port}/fronts/", tmp_path / "serve.log")
        assert KFUSION.stem in page
        style = re.search(r'href="(/static/[^"]+\.css)"', page)
        assert style is not None
        assert "{" in fetch(server, f"http://127.0.0.1:{port}{style[1]}", tmp_path / "serve.log")
        guide = fetch(server, f"http://127.0.0.1:{port}/guide/", tmp_path / "serve.log")
        assert "toctree" in guide
    finally:
        server.send_signal(signal.SIGTERM)
        server.wait(30)
    assert (tmp_path / "data" / "frontrunner" / "server" / "frontrunner.sqlite3").exists()


def fetch(server: "subprocess.Popen[bytes]", address: str, log: Path) -> str:
    """What `address` answers as soon as `server`, which writes `log`, answers at all."""

    def answer() -> str:
        assert server.poll() is None, log.read_text()
        try:
            with urllib.request.urlopen(address, timeout=10) as response:
                return str(response.read().decode())
        except OSError:  # a busy machine may answer too late, too
            return ""

    return str(until(answer, seen=log.read_text))
