"""Build options of a run: what they do to compiler, launches and threads, and where they are refused."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import fields
from pathlib import Path

import pytest

import pareto
from pareto import Space
from slam.__main__ import main
from slam.configuration import ConfigurationError
from slam.devices.build import DEFAULT, REFUSED, Build, split
from slam.devices.choice import choose_device, list_devices
from slam.devices.layout import Layout
from slam.devices.opencl import Session
from slam.devices.tuning import Trial, layout_for
from slam.registry import PROGRAMS, open_session
from tests.slam.tiny import write_tiny_pack

TRIAL = PROGRAMS["kfusion"].trial
SYSTEMS = Space.load(Path(pareto.__file__).parent / "spaces" / "systems.json")
OPTIONS = 0x1182  # CL_PROGRAM_BUILD_OPTIONS
BUSY = """
kernel void busy(global float *x)
{
    float sum = get_global_id(0);
    for (int i = 0; i < 2000000; ++i)
        sum = sum * 0.999f + 1.0f;
    x[get_global_id(0)] = sum;
}
"""


def test_a_configuration_without_build_options_means_the_default_build():
    values = {"mu": 0.1, "volume_resolution": 64}
    assert split(values) == (values, DEFAULT)
    assert DEFAULT.options == (
        "-cl-std=CL1.2", "-cl-mad-enable", "-cl-unsafe-math-optimizations", "-cl-denorms-are-zero",
    )  # fmt: skip
    assert (DEFAULT.layout, DEFAULT.changed, str(DEFAULT)) == (None, {}, "")


def test_build_options_are_told_from_parameters():
    parameters, build = split({"mu": 0.1, "build_threads": 2, "build_unsafe_math": 0})
    assert parameters == {"mu": 0.1}
    assert build == Build(build_threads=2, build_unsafe_math=False)
    assert str(build) == "build_unsafe_math=0 build_threads=2"


@pytest.mark.parametrize(
    ("build", "changes"),
    [
        (Build(build_unsafe_math=False), {"-cl-unsafe-math-optimizations"}),
        (Build(build_mad_enable=False), {"-cl-mad-enable"}),
        (Build(build_no_signed_zeros=True), {"-cl-no-signed-zeros"}),
    ],
)
def test_the_compiler_gets_the_options(build, changes, tmp_path):
    source = tmp_path / "busy.cl"
    source.write_text(BUSY)
    given = []
    for chosen in (DEFAULT, build):
        session = Session(choose_device(), build=chosen)
        info = session.program(source).get_build_info(choose_device().handle, OPTIONS)
        given.append(set(info.split()))
    assert given[0] ^ given[1] == changes


def test_groups_of_one_walk_rows_and_wider_ones_have_their_size():
    assert Build(build_group_width=1).layout == Layout("rows")
    build = Build(build_group_width=32, build_group_height=4)
    assert build.layout == Session(choose_device(), build=build).layout == Layout("pixels", (32, 4))


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells what each thread did")
def test_a_number_of_threads_is_how_many_compute(tmp_path):
    def ticks() -> dict[str, int]:
        tasks = Path("/proc/self/task")
        return {each: sum(map(int, (tasks / each / "stat").read_text().split()[13:15]))
                for each in os.listdir(tasks)}  # fmt: skip

    source = tmp_path / "busy.cl"
    source.write_text(BUSY)
    for device in (device for device in list_devices() if device.kind == "cpu"):
        session = Session(device, build=Build(build_threads=1))
        assert session.device.compute_units == 1
        kernel = session.kernel(source, "busy", (256,), session.buffer(4 * 256))
        kernel()
        session.finish()
        before = ticks()
        kernel()
        session.finish()
        worked = [count - before.get(task, 0) for task, count in ticks().items()]
        assert max(worked) > 0.9 * sum(worked) > 0


def test_the_memory_of_layouts_is_of_one_build(tmp_path, monkeypatch):
    monkeypatch.delenv("FRONTRUNNER_KERNELS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    monkeypatch.setattr("pathlib.Path.home", lambda: tmp_path)
    tried = []
    monkeypatch.setattr(Trial, "seconds", lambda *given: tried.append(given[4]) or 1.0)
    for build in (DEFAULT, Build(build_threads=1), Build(build_unsafe_math=False), DEFAULT):
        layout_for(choose_device(), TRIAL, build=build)
    (file,) = tmp_path.rglob("layouts.json")
    assert len(json.loads(file.read_text())) == len(set(tried)) == 3
    assert layout_for(choose_device(), TRIAL, build=Build(build_group_width=1)) == Layout("rows")
    assert len(set(tried)) == 3


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"build_fast_relaxed_math": 1}, "build_fast_relaxed_math=1: -cl-fast-relaxed-math .* use build_uns"),
        ({"build_finite_math_only": 1}, "build_finite_math_only=1: -cl-finite-math-only .* use build_unsafe"),
        ({"build_thread": 1}, "unknown parameter build_thread: a build has build_unsafe_math"),
        ({"build_unsafe_math": 2}, "build_unsafe_math=2: must be true or false"),
        ({"build_group_width": 256}, "build_group_width=256, build_group_height=8: a group has at most 1024"),
        ({"build_threads": -1}, "build_threads=-1: must be at least 0"),
    ],
)
def test_bad_options_are_named_with_what_would_be_right(values, words):
    with pytest.raises(ConfigurationError, match=words):
        split(values)


def test_no_build_has_what_is_refused():
    every = Build(build_unsafe_math=True, build_mad_enable=True, build_no_signed_zeros=True)
    assert not set(every.options) & set(REFUSED.values())


def test_more_threads_than_the_device_has_are_refused():
    device = choose_device()
    with pytest.raises(ConfigurationError, match=rf"build_threads=999: .* has {device.compute_units}: give "):
        Session(device, build=Build(build_threads=999))


@pytest.mark.parametrize(("backend", "name"), [("wasm", "WebAssembly"), ("webgpu", "WebGPU")])
def test_other_backends_have_no_build_options(backend, name):
    if not list_devices(backend):
        pytest.skip(f"no device of {name}")
    with pytest.raises(ConfigurationError, match=rf"build_threads=1: {name} has no .* use OpenCL"):
        open_session("kfusion", choose_device(backend=backend), build=Build(build_threads=1))


def test_one_space_searches_over_build_options_beside_parameters():
    names = [field.name for field in fields(Build)]
    assert split(SYSTEMS.default)[1] == DEFAULT
    for name in names:
        (parameter,) = (each for each in SYSTEMS.parameters if each.name == name)
        for value in parameter.values:
            split({name: value})
    assert SYSTEMS.conditions.parents("build_mad_enable") == ("build_unsafe_math",)


@pytest.mark.slow
def test_a_run_reports_its_build(tmp_path, capsys):
    pack, report = write_tiny_pack(tmp_path), tmp_path / "report.json"
    point = json.dumps(
        SYSTEMS.default
        | {"volume_resolution": 64, "build_unsafe_math": False, "build_mad_enable": False}
        | {"build_group_width": 16, "build_group_height": 4, "build_threads": 1}
    )
    assert main(["run", "--sequence", str(pack), "--set", point, "--json", str(report)]) == 0
    read = json.loads(report.read_text())
    assert read["build"] == {
        "build_unsafe_math": False, "build_mad_enable": False, "build_no_signed_zeros": False,
        "build_group_width": 16, "build_group_height": 4, "build_threads": 1,
        "options": "-cl-std=CL1.2 -cl-denorms-are-zero", "layout": "16x4",
    }  # fmt: skip
    assert not [name for name in read["configuration"] if name.startswith("build_")]
    assert "build_unsafe_math=False build_mad_enable=False build_group_width=16" in capsys.readouterr().out
    assert main(["compare", str(report), "volume_resolution=64", "--sequence", str(pack)]) == 0
    assert "build_threads: 1 | -" in capsys.readouterr().out
