import pytest

from slam.power import EnergyMeter, EnergyReading


def package(root, number, microjoules, limit=1_000_000):
    return files(
        root / "class/powercap" / f"intel-rapl:{number}",
        energy_uj=microjoules,
        max_energy_range_uj=limit,
    ) / "energy_uj"  # fmt: skip


def files(folder, **contents):
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        (folder / name).write_text(f"{content}\n")
    return folder


def watts(meter):
    """The power that a meter of sensors takes over a second in which it does not change."""
    values = meter.read().values
    return meter.joules(EnergyReading(1.0, values), EnergyReading(2.0, values))


def test_energy_of_all_packages_is_added_and_their_parts_are_not(tmp_path):
    counters = [package(tmp_path, "0", 100), package(tmp_path, "1", 200), package(tmp_path, "0:0", 50)]
    meter = EnergyMeter(tmp_path)
    before = meter.read()
    for counter, value in zip(counters, (1_100, 2_200, 9_999), strict=True):
        counter.write_text(f"{value}\n")
    assert meter.source == "rapl"
    assert meter.joules(before, meter.read()) == pytest.approx(3e-3)


def test_a_counter_that_wrapped_goes_on_from_zero(tmp_path):
    counter = package(tmp_path, "0", 999_000, limit=1_000_000)
    meter = EnergyMeter(tmp_path)
    before = meter.read()
    counter.write_text("500\n")
    assert meter.joules(before, meter.read()) == pytest.approx(1.5e-3)


def test_a_platform_that_tells_nothing_has_unknown_energy_and_not_zero(tmp_path):
    package(tmp_path, "0", "not a number")
    for root in (tmp_path / "nowhere", tmp_path):
        meter = EnergyMeter(root)
        assert not meter.available
        assert meter.source is None
        assert meter.joules(meter.read(), meter.read()) is None


def test_power_of_an_ina_sensor_is_taken_from_all_its_rails(tmp_path):
    files(tmp_path / "class/hwmon/hwmon0", name="ina231", power1_input=1_500_000)
    files(tmp_path / "class/hwmon/hwmon1", name="ina226", power1_input=500_000, curr1_input=9, in1_input=9)
    files(tmp_path / "class/hwmon/hwmon2", name="coretemp", power1_input=9_000_000)
    meter = EnergyMeter(tmp_path)
    assert meter.source == "ina"
    assert watts(meter) == pytest.approx(2.0)


def test_an_ina3221_without_power_gives_current_times_voltage(tmp_path):
    chip = files(tmp_path / "class/hwmon/hwmon3", name="ina3221")
    files(
        chip,
        curr1_input=200,
        in1_input=5_000,
        curr2_input=100,
        in2_input=12_000,
        curr4_input=300,
        in4_input=40,
    )
    assert watts(EnergyMeter(tmp_path)) == pytest.approx(1.0 + 1.2)


def test_the_boards_input_is_not_added_to_the_rails_that_it_feeds(tmp_path):
    chip = files(tmp_path / "class/hwmon/hwmon1", name="ina3221", in1_label="VDD_IN", in2_label="VDD_SOC")
    files(chip, curr1_input=1_000, in1_input=5_000, curr2_input=400, in2_input=5_000)
    assert watts(EnergyMeter(tmp_path)) == pytest.approx(5.0)


def test_power_that_rises_counts_with_its_mean(tmp_path):
    chip = files(tmp_path / "class/hwmon/hwmon0", name="ina219", power1_input=2_000_000)
    meter = EnergyMeter(tmp_path)
    before = EnergyReading(10.0, meter.read().values)
    files(chip, power1_input=4_000_000)
    assert meter.joules(before, EnergyReading(10.5, meter.read().values)) == pytest.approx(1.5)


@pytest.mark.parametrize("current", [-250_000, 250_000])
def test_a_battery_tells_the_power_of_the_whole_device_whatever_its_sign(tmp_path, current):
    folder = tmp_path / "class/power_supply"
    files(folder / "usb", type="USB", current_now=9, voltage_now=9)
    files(
        folder / "battery", type="Battery", status="Discharging", current_now=current, voltage_now=4_000_000
    )
    meter = EnergyMeter(tmp_path)
    assert meter.source == "battery"
    assert watts(meter) == pytest.approx(1.0)


def test_a_battery_on_its_charger_tells_nothing(tmp_path):
    battery = files(
        tmp_path / "class/power_supply/battery", type="Battery", current_now=250_000, voltage_now=4_000_000
    )
    for status in ("Charging", "Full", "Not charging"):
        files(battery, status=status)
        assert not EnergyMeter(tmp_path).available
    files(battery, status="Discharging")
    meter = EnergyMeter(tmp_path)
    before = meter.read()
    files(battery, status="Charging")
    assert meter.joules(before, meter.read()) is None


@pytest.mark.parametrize("current", [0, 250])  # an empty gauge, and one in milliamperes
def test_a_gauge_that_cannot_be_right_tells_nothing(tmp_path, current):
    battery = tmp_path / "class/power_supply/battery"
    files(battery, type="Battery", status="Discharging", current_now=current, voltage_now=4_000_000)
    assert not EnergyMeter(tmp_path).available


def test_counters_of_the_processor_go_before_sensors_of_the_board(tmp_path):
    package(tmp_path, "0", 100)
    files(tmp_path / "class/hwmon/hwmon0", name="ina231", power1_input=1_500_000)
    meter = EnergyMeter(tmp_path)
    assert meter.source == "rapl"
    assert len(meter.read().values) == 1
