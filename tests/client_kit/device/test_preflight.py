"""Obstacles to measuring now, each with a remedy."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from client_kit.device import condition, preflight
from client_kit.device.preflight import concerns, require_fit, too_large, unsupported
from client_kit.errors import CannotMeasureError
from client_kit.home import Home
from tests.client_kit.machines import files

MIB = 2**20
BATTERY = {
    "sys/class/power_supply/BAT0/type": "Battery",
    "sys/class/power_supply/BAT0/capacity": "9",
    "sys/class/power_supply/BAT0/status": "Discharging",
}
SAVING = {"sys/firmware/acpi/platform_profile": "low-power"}
HOT = {
    "sys/class/thermal/cooling_device0/type": "Processor",
    "sys/class/thermal/cooling_device0/cur_state": "4",
}


@pytest.mark.parametrize(
    ("contents", "name", "words"),
    [
        (BATTERY, "battery", "the battery is at 9 %: plug the device in, or add --ignore battery"),
        (SAVING, "power-saving", "power saving is on.*switch it off, or add --ignore power-saving"),
        (HOT, "throttling", "the device throttles, Processor is slowed down.*or add --ignore throttling"),
    ],
)
def test_what_would_spoil_a_measurement_stops_it_unless_ignored(
    contents: dict[str, str], name: str, words: str, tmp_path: Path, home: Home, programs: Path
) -> None:
    files(tmp_path, contents)
    found = concerns(home, tmp_path, "linux")

    with pytest.raises(CannotMeasureError, match=words):
        require_fit(found)
    assert [concern.name for concern in require_fit(found, ignored=(name,))] == [name]


def test_a_busy_machine_is_a_warning_and_not_an_error(tmp_path: Path, home: Home, programs: Path) -> None:
    files(tmp_path, {"proc/loadavg": "900.0 1 1 1/1 1\n"})

    [concern] = require_fit(concerns(home, tmp_path, "linux"))

    assert "other programs keep this device busy (load 900.0 on" in concern.text


def test_a_disk_without_room_for_a_session_or_the_sequence_stops_before_anything_is_measured(
    tmp_path: Path, home: Home, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condition, "free_disk", lambda _: 3 * MIB)
    with pytest.raises(CannotMeasureError, match=r"3 MiB are left on the disk of .*could not be kept"):
        require_fit(concerns(home, tmp_path, "linux"), preflight.IGNORABLE)

    monkeypatch.setattr(condition, "free_disk", lambda _: 20 * MIB)
    assert concerns(home, tmp_path, "linux") == []
    (concern,) = concerns(home, tmp_path, "linux", download=13 * MIB)
    assert "29 are needed" in concern.text


def test_a_machine_that_tells_nothing_measures(tmp_path: Path, home: Home, programs: Path) -> None:
    assert concerns(home, tmp_path, "linux") == []


def device(
    kind: str = "gpu",
    allocation: int = 4096,
    memory: int = 8192,
    unified: bool = True,
    backend: str = "opencl",
) -> Any:
    return SimpleNamespace(
        backend=backend,
        kind=kind,
        max_allocation=allocation * MIB,
        global_memory=memory * MIB,
        handle=SimpleNamespace(host_unified_memory=unified),
    )


VOLUMES = {"default": {"volume_resolution": 256}, "fine": {"volume_resolution": 512}}


@pytest.mark.parametrize(
    ("chosen", "free", "words"),
    [
        (device(allocation=384), 8192, "one buffer of 512 MiB, the device allows 384 MiB"),
        (device(memory=500), 8192, "512 MiB, the device has 500 MiB"),
        (device(), 300, "512 MiB, 300 MiB are free: end other programs"),
        (device("cpu", memory=600), 8192, "640 MiB, the device has 600 MiB"),
        (device("cpu", unified=False), 300, "640 MiB, 300 MiB are free: end other programs"),
        (device("cpu", 128, 0, backend="webgpu"), 8192, "one buffer of 512 MiB, the device allows 128 MiB"),
        (device("cpu", 1024, 0, backend="webgpu"), 300, "512 MiB, 300 MiB are free: end other programs"),
        (device("cpu", 4096, 600, backend="wasm"), 8192, "640 MiB, the device has 600 MiB"),
    ],
)
def test_a_volume_that_does_not_fit_is_known_before(
    chosen: Any, free: int, words: str, tmp_path: Path
) -> None:
    files(tmp_path, {"proc/meminfo": f"MemAvailable: {free * 1024} kB\n"})

    assert too_large(VOLUMES, chosen, tmp_path) == {"fine": f"volume_resolution=512 needs {words}"}


def test_what_is_not_said_and_a_graphics_cards_own_memory_forbid_nothing(tmp_path: Path) -> None:
    assert too_large(VOLUMES, device(), tmp_path) == {}
    assert too_large(VOLUMES, device(memory=0, backend="webgpu"), tmp_path) == {}

    files(tmp_path, {"proc/meminfo": "MemAvailable: 1024 kB\n"})
    assert too_large(VOLUMES, device(unified=False), tmp_path) == {}


def test_a_configuration_that_the_backend_cannot_run_is_known_before() -> None:
    backends = {"default": ("opencl", "webgpu"), "fine": ("opencl",)}

    assert unsupported(backends, "opencl") == {}
    assert unsupported(backends, "wasm") == {}
    assert unsupported(backends, "webgpu") == {"fine": "fine does not run on webgpu: it needs opencl"}
