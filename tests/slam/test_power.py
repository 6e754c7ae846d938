import pytest

from slam.power import EnergyMeter


def package(root, number, microjoules, limit=1_000_000):
    folder = root / f"intel-rapl:{number}"
    folder.mkdir()
    (folder / "energy_uj").write_text(f"{microjoules}\n")
    (folder / "max_energy_range_uj").write_text(f"{limit}\n")
    return folder / "energy_uj"


def test_energy_of_all_packages_is_added_and_their_parts_are_not(tmp_path):
    counters = [package(tmp_path, "0", 100), package(tmp_path, "1", 200), package(tmp_path, "0:0", 50)]
    meter = EnergyMeter(tmp_path)
    before = meter.read()
    for counter, value in zip(counters, (1_100, 2_200, 9_999), strict=True):
        counter.write_text(f"{value}\n")
    assert meter.available
    assert meter.joules(before, meter.read()) == pytest.approx(3e-3)


def test_a_counter_that_wrapped_goes_on_from_zero(tmp_path):
    counter = package(tmp_path, "0", 999_000, limit=1_000_000)
    meter = EnergyMeter(tmp_path)
    before = meter.read()
    counter.write_text("500\n")
    assert meter.joules(before, meter.read()) == pytest.approx(1.5e-3)


def test_without_readable_counters_there_is_no_energy(tmp_path):
    assert not EnergyMeter(tmp_path / "nowhere").available
    package(tmp_path, "0", "not a number")
    meter = EnergyMeter(tmp_path)
    assert not meter.available
    assert meter.joules(meter.read(), meter.read()) == 0
