"""Rules that the whole repository keeps: the direction of imports, and what may not be committed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def tracked_files() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout: there is no list of tracked files to look through")
    return [ROOT / name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


def test_imports_run_one_way():
    command = [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-development.lock"])
def test_locks_have_hashes_and_no_addresses(name):
    text = (ROOT / name).read_text()
    assert "://" not in text
    pinned = re.findall(r"^[a-z0-9][\w.\[\]-]*==\S+.*(?:\n    .*)*", text, re.MULTILINE)
    assert len(pinned) > 30
    assert all("--hash=sha256:" in requirement for requirement in pinned)


def test_no_tracked_file_is_large():
    """A pack of the sequence is split into chunks; nothing else is big."""
    large = [path for path in tracked_files() if path.stat().st_size > 8 * 2**20]
    assert large == []


@pytest.mark.parametrize("package", ["pyopencl", "wgpu"])
def test_one_module_drives_the_devices_of_a_backend(package):
    """Neither may be imported before it is needed: OpenCL hangs in a forked child."""
    found = {
        str(path.relative_to(ROOT))
        for path in tracked_files()
        if path.suffix == ".py"
        and re.search(rf"^\s*(import|from) {package}\b", path.read_text(), re.MULTILINE)
    }

    assert found == {f"slam/devices/{'opencl' if package == 'pyopencl' else 'webgpu'}.py"}
