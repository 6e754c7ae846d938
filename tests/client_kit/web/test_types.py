"""The types of the browser's modules, checked by TypeScript."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.client_kit.web.serving import WEB

TSC = ("--yes", "--prefer-offline", "--package", "typescript@6.0.3", "tsc")  # its libraries know WebGPU


def checked(project: Path) -> subprocess.CompletedProcess[str]:
    """What TypeScript says of PROJECT; a skip with its reason where it is not at hand."""
    npx = shutil.which("npx")
    if npx is None:
        pytest.skip("no npx: node is not installed")
    command = [npx, *TSC, "--project", os.fspath(project)]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=180)
    except subprocess.TimeoutExpired:
        pytest.skip("no package registry answers: TypeScript is not at hand")
    if ended.returncode and "error TS" not in ended.stdout:
        pytest.skip(f"TypeScript is not at hand: {ended.stderr.strip().splitlines()[-1:]}")
    return ended


@pytest.mark.slow
@pytest.mark.parametrize("project", sorted(path.name for path in WEB.glob("*config*.json")))
def test_the_modules_keep_their_types(project: str) -> None:
    ended = checked(WEB / project)

    assert ended.returncode == 0, ended.stdout + ended.stderr
