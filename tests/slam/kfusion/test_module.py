"""The module of KinectFusion's kernels: nothing but our functions, and the bytes that its sources give."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from slam.devices import wasm
from slam.kfusion import module
from slam.kfusion.declarations import ADAPTIVE_KERNELS, VIEW_KERNELS, kernels_of
from slam.kfusion.pipeline import FOLDERS
from slam.plans.wasm import MODULE
from slam.plans.wasm_module import build

ROOT = Path(__file__).parents[3]
SHIPPED = FOLDERS[0] / MODULE
CODE, NAMES = 10, b"name"  # a section's number; the name of one that is numbered 0
NAMES_OF_FUNCTIONS = 1

compiler = pytest.mark.skipif(
    find_spec("ziglang") is None,
    reason="no compiler for WebAssembly: make kernels installs the package ziglang",
)


def number(data: bytes, at: int) -> tuple[int, int]:
    """The LEB128 number that begins at `at`, and where it ends."""
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at


def sections(data: bytes, at: int) -> Iterator[tuple[int, bytes]]:
    """Number and content of each section from `at` on."""
    while at < len(data):
        kind = data[at]
        size, at = number(data, at + 1)
        yield kind, data[at : at + size]
        at += size


def function_names(data: bytes) -> list[str]:
    """The functions of a module that was linked without `--strip-all`; a header's occur once a source."""
    custom = next(each for kind, each in sections(data, 8) if not kind and each[1:].startswith(NAMES))
    listed = next(each for kind, each in sections(custom, 1 + len(NAMES)) if kind == NAMES_OF_FUNCTIONS)
    count, at = number(listed, 0)
    names = []
    for _ in range(count):
        _, at = number(listed, at)
        size, at = number(listed, at)
        names.append(listed[at : at + size].decode())
        at += size
    return names


def function_count(data: bytes) -> int:
    return number(next(each for kind, each in sections(data, 8) if kind == CODE), 0)[0]


def test_the_module_asks_for_memory_alone_and_keeps_out_of_the_way_of_plans():
    """What belongs to it ends before the stacks and buffers that a plan adds."""
    session = wasm.WebAssemblySession(wasm.list_devices()[0], threads=1)
    machine = session.machine(SHIPPED, session.first_free)
    loaded = session._modules[SHIPPED]
    assert [(each.module, each.name) for each in loaded.imports] == [("env", "memory")]
    assert sorted(each.name for each in loaded.exports) == sorted(build.EXPORTS)
    assert 0 < machine._exports["__heap_base"].value(machine._store) <= wasm.OWN


@pytest.mark.slow
@compiler
def test_the_shipped_module_is_what_its_sources_give(tmp_path):
    """In another folder, with an empty cache."""
    for name in ("slam", "frontrunner"):
        ignored = shutil.ignore_patterns("__pycache__", "guide", MODULE)
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    target, cache = tmp_path / "built.wasm", str(tmp_path / "cache")
    ended = subprocess.run(
        [sys.executable, "-m", module.__name__, target],
        cwd=tmp_path,
        env=os.environ | {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache, "PYTHONPATH": ""},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    assert target.read_bytes() == SHIPPED.read_bytes(), "run make kernels"


@pytest.mark.slow
@compiler
def test_every_function_of_the_module_is_ours_and_no_library_is_linked(tmp_path, monkeypatch):
    target = tmp_path / "named.wasm"
    monkeypatch.setattr(build, "LINK", tuple(option for option in build.LINK if option != "--strip-all"))
    monkeypatch.setattr(sys, "argv", ["module", str(target)])
    module.main()

    listed = function_names(target.read_bytes())
    names = set(listed)
    kernels = (*kernels_of(wasm.LAYOUT), *ADAPTIVE_KERNELS, *VIEW_KERNELS)
    generated = {"launch", *(f"run_{kernel.name}" for kernel in kernels)}
    by_the_linker = {"__wasm_init_memory"}  # copies the constants of kernels into memory, once
    sources = [
        path
        for folder in (*FOLDERS, build.HERE)
        for path in folder.glob("*.*")
        if path.suffix in (".cl", ".h", ".c")
    ]
    text = "\n".join(path.read_text() for path in sources)
    written = {name for name in names if re.search(rf"^[a-z][\w *]*\b{name}\(", text, re.MULTILINE)}
    assert generated <= names
    assert names - generated - by_the_linker == written - generated
    assert len(listed) == function_count(SHIPPED.read_bytes())
