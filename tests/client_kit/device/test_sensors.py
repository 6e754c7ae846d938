"""Temperature, clock and battery from a fake sysfs."""

from pathlib import Path

from client_kit.device.sensors import Sampler, battery, clock, temperature
from tests.client_kit.machines import files
from wire.session import Sample

ZONES = "sys/class/thermal/thermal_zone"


def zones(root: Path, *contents: dict[str, str]) -> None:
    """Thermal zones with files of these `contents`."""
    for number, one in enumerate(contents):
        files(root, {f"{ZONES}{number}/{name}": f"{text}\n" for name, text in one.items()})


def test_the_hottest_plausible_zone_counts(tmp_path: Path) -> None:
    zones(tmp_path, *({"temp": text} for text in ("41500", "63250", "-274000", "not readable", "2147483647")))

    assert temperature(tmp_path) == 63.25


def test_zones_in_whole_degrees_are_understood(tmp_path: Path) -> None:
    zones(tmp_path, {"temp": "47"})

    assert temperature(tmp_path) == 47


def test_zones_without_a_temperature_are_left_aside(tmp_path: Path) -> None:
    others = {"soc": "87", "pm8150b-vbat-lvl0": "3900", "pm8150b-ibat-lvl0": "1500"}
    zones(
        tmp_path,
        {"type": "cpu-1-0-usr", "temp": "41000"},
        *({"type": kind, "temp": value} for kind, value in others.items()),
        {"type": "x", "policy": "low_limits_cap", "temp": "99"},
    )

    assert temperature(tmp_path) == 41


def test_the_fastest_core_gives_the_clock(tmp_path: Path) -> None:
    for core, text in {"cpu0": "300000\n", "cpu7": "2841600\n"}.items():
        files(tmp_path, {f"sys/devices/system/cpu/{core}/cpufreq/scaling_cur_freq": text})

    assert clock(tmp_path) == 2841.6


def test_what_the_platform_hides_is_null(tmp_path: Path) -> None:
    assert (temperature(tmp_path), clock(tmp_path), battery(tmp_path)) == (None, None, None)


def test_a_discharging_battery_below_a_fifth_is_low(tmp_path: Path) -> None:
    supply = "sys/class/power_supply/BAT0"
    files(tmp_path, {f"{supply}/type": "Battery\n", f"{supply}/capacity": "12\n"})

    for status, low in {"Discharging": True, "Charging": False, "Unknown": True}.items():
        files(tmp_path, {f"{supply}/status": f"{status}\n"})
        charge = battery(tmp_path)
        assert charge is not None
        assert charge.low is low


def test_the_battery_of_a_mouse_is_not_the_devices(tmp_path: Path) -> None:
    supply = "sys/class/power_supply/hidpp_battery_0"
    files(tmp_path, {f"{supply}/type": "Battery", f"{supply}/scope": "Device", f"{supply}/capacity": "5"})

    assert battery(tmp_path) is None


def test_samples_are_taken_at_most_once_a_second(tmp_path: Path) -> None:
    zones(tmp_path, {"temp": "50000"})
    times = iter([100.0, 100.4, 100.999, 101.0, 101.5, 102.1])
    sampler = Sampler(tmp_path, now=lambda: next(times))

    for _ in range(6):
        sampler.sample()

    assert [sample.t for sample in sampler.samples] == [0.0, 1.0, 2.1]
    assert sampler.samples[0] == Sample(0.0, 50.0, None, None)
