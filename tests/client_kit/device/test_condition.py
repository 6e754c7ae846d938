"""The state of a device before it measures, on machines played by a fake root and fake programs."""

from pathlib import Path

import pytest

from client_kit.device import condition
from client_kit.device.sensors import Battery
from tests.client_kit.machines import files, program

CPU0 = "sys/devices/system/cpu/cpu0/cpufreq"
THERMAL = "sys/class/thermal"


@pytest.mark.parametrize(
    ("output", "battery"),
    [
        ('{"percentage": 14, "status": "DISCHARGING"}', Battery(14.0, True)),
        ("Termux:API is not yet available", None),  # without its companion app
    ],
)
def test_a_phone_that_hides_its_battery_is_asked_through_termux(
    output: str, battery: Battery | None, tmp_path: Path, programs: Path
) -> None:
    program(programs, "termux-battery-status", f"echo '{output}'")

    assert condition.battery(tmp_path, "linux") == battery


@pytest.mark.parametrize(
    ("output", "battery"),
    [
        (
            "Now drawing from 'Battery Power'\n -InternalBattery-0\t17%; discharging; 1:02",
            Battery(17.0, True),
        ),
        (
            "Now drawing from 'AC Power'\n -InternalBattery-0 (id=1)\t17%; charging; 1:02",
            Battery(17.0, False),
        ),
        ("Now drawing from 'AC Power'", None),
    ],
)
def test_a_mac_is_asked_by_pmset(
    output: str, battery: Battery | None, tmp_path: Path, programs: Path
) -> None:
    program(programs, "pmset", f"cat <<'END'\n{output}\nEND")

    assert condition.battery(tmp_path, "darwin") == battery


def test_a_mac_in_low_power_mode_and_held_down_says_so(tmp_path: Path, programs: Path) -> None:
    answers = '[ "$2" = therm ] && echo "CPU_Speed_Limit = 62" || echo " lowpowermode         1"'
    program(programs, "pmset", answers)

    assert condition.power_saving(tmp_path, "darwin") is True
    assert condition.throttling(tmp_path, "darwin") == "the processor is held to 62 %"


@pytest.mark.parametrize(
    ("contents", "saving"),
    [
        ({"sys/firmware/acpi/platform_profile": "low-power\n"}, True),
        ({"sys/firmware/acpi/platform_profile": "balanced\n"}, False),
        ({f"{CPU0}/scaling_governor": "powersave\n", f"{CPU0}/scaling_driver": "cpufreq-dt\n"}, True),
        # intel_pstate's powersave is its ordinary governor.
        ({f"{CPU0}/scaling_governor": "powersave\n", f"{CPU0}/scaling_driver": "intel_pstate\n"}, False),
        ({f"{CPU0}/scaling_governor": "schedutil\n", f"{CPU0}/scaling_driver": "cpufreq-dt\n"}, False),
        ({}, None),
    ],
)
def test_power_saving_is_read_from_profile_and_governor(
    contents: dict[str, str], saving: bool | None, tmp_path: Path, programs: Path
) -> None:
    files(tmp_path, contents)

    assert condition.power_saving(tmp_path, "linux") is saving


@pytest.mark.parametrize(("output", "saving"), [("1", True), ("0", False), ("null", None), ("", None)])
def test_android_tells_of_its_battery_saver(
    output: str, saving: bool | None, tmp_path: Path, programs: Path
) -> None:
    program(programs, "settings", f"echo '{output}'")

    assert condition.power_saving(tmp_path, "linux") is saving


def test_a_cooling_device_at_work_is_throttling_and_a_fan_is_not(tmp_path: Path) -> None:
    fan, processor = f"{THERMAL}/cooling_device0", f"{THERMAL}/cooling_device1"

    files(tmp_path, {f"{fan}/type": "Fan\n", f"{fan}/cur_state": "3\n"})
    assert condition.throttling(tmp_path, "linux") is None
    files(tmp_path, {f"{processor}/type": "thermal-cpufreq-0\n", f"{processor}/cur_state": "2\n"})
    assert condition.throttling(tmp_path, "linux") == "thermal-cpufreq-0 is slowed down (step 2)"


@pytest.mark.parametrize(
    ("kind", "present", "trip"),
    [("vbat", "3900", "3300"), ("soc", "87", "10"), ("x86_pkg_temp", "61000", "60000")],
)
def test_a_zone_beyond_its_passive_trip_need_not_be_throttling(
    kind: str, present: str, trip: str, tmp_path: Path
) -> None:
    zone = {"type": kind, "temp": present, "trip_point_0_type": "passive", "trip_point_0_temp": trip}
    files(tmp_path, {f"{THERMAL}/thermal_zone0/{name}": f"{text}\n" for name, text in zone.items()})

    assert condition.throttling(tmp_path, "linux") is None


def test_load_and_memory_are_the_kernels(tmp_path: Path) -> None:
    assert condition.load(tmp_path, "linux") is None
    assert condition.free_memory(tmp_path) is None

    memory = "MemTotal:  7900000 kB\nMemFree: 100 kB\nMemAvailable:    2048 kB\n"
    files(tmp_path, {"proc/loadavg": "1.75 0.90 0.40 2/311 4242\n", "proc/meminfo": memory})

    assert condition.load(tmp_path, "linux") == 1.75
    assert condition.free_memory(tmp_path) == 2 * 2**20
