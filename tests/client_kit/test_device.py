"""What a device says of itself, on machines played by a fake root folder and fake programs on PATH."""

import csv
import os
import platform
from pathlib import Path
from types import SimpleNamespace

import pytest

from client_kit.device import ANDROID_PROPERTIES, FIELDS, LONGEST, _windows, identify, opencl_identity

GALAXY = {
    "ro.build.version.release": "14",
    "ro.product.manufacturer": "samsung",
    "ro.product.brand": "samsung",
    "ro.product.model": "SM-A166B",
    "ro.product.device": "a16x",
    "ro.product.board": "s5e8535",
    "ro.soc.manufacturer": "Samsung",
    "ro.soc.model": "s5e8535",
    "ro.board.platform": "erd8535",
    "ro.hardware.egl": "mali",
    "ro.serialno": "R58N12345XX",
    "ro.boot.serialno": "R58N12345XX",
}


def program(folder: Path, name: str, text: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def getprop(folder: Path, properties: dict[str, str]) -> None:
    cases = "\n".join(f"'{key}') printf '%s\\n' '{value}';;" for key, value in properties.items())
    program(folder, "getprop", f'case "$1" in\n{cases}\n*) echo;;\nesac')


def files(root: Path, contents: dict[str, str]) -> None:
    for name, text in contents.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}/bin{os.pathsep}/usr/bin")
    return folder


def test_an_android_phone_is_described_by_its_properties_and_nothing_else(
    tmp_path: Path, programs: Path
) -> None:
    getprop(programs, GALAXY)
    files(tmp_path, {"proc/cpuinfo": ARM_CPUINFO})

    identity = identify(tmp_path, "linux")

    assert {field: identity[field] for field in ANDROID_PROPERTIES} == {
        field: GALAXY[key] for field, key in ANDROID_PROPERTIES.items()
    }
    assert identity["os"] == "Android"
    assert identity["cpu_parts"] == "0x41:0xd05 0x41:0xd41"
    assert identity["cpu_count"] == "3"
    assert "R58N12345XX" not in str(identity)


def test_properties_that_the_phone_hides_are_null(tmp_path: Path, programs: Path) -> None:
    getprop(programs, {"ro.product.model": "Pixel 8"})

    identity = identify(tmp_path, "linux")

    assert identity["model"] == "Pixel 8"
    assert identity["soc_model"] is None
    assert identity["manufacturer"] is None


def test_a_getprop_that_fails_is_not_an_android(tmp_path: Path, programs: Path) -> None:
    program(programs, "getprop", "exit 1")
    files(tmp_path, {"etc/os-release": 'NAME="Debian GNU/Linux"\nVERSION_ID="12"\n'})

    assert identify(tmp_path, "linux")["os"] == "Debian GNU/Linux"


def test_a_pc_is_described_by_dmi_and_cpuinfo(tmp_path: Path, programs: Path) -> None:
    files(
        tmp_path,
        {
            "etc/os-release": "NAME='Ubuntu'\nVERSION_ID=\"24.04\"\n",
            "sys/class/dmi/id/sys_vendor": "LENOVO\n",
            "sys/class/dmi/id/product_name": "20XW004AGE\n",
            "sys/class/dmi/id/product_serial": "PF2ABCDE\n",
            "sys/class/dmi/id/product_uuid": "11111111-2222-3333-4444-555555555555\n",
            "proc/cpuinfo": "processor\t: 0\nmodel name\t: 11th Gen Intel(R) Core(TM) i7-1165G7 @ 2.80GHz\n",
        },
    )

    identity = identify(tmp_path, "linux")

    assert identity["manufacturer"] == "LENOVO"
    assert identity["model"] == "20XW004AGE"
    assert identity["os"] == "Ubuntu"
    assert identity["os_version"] == "24.04"
    assert identity["cpu"] == "11th Gen Intel(R) Core(TM) i7-1165G7 @ 2.80GHz"
    assert "PF2ABCDE" not in str(identity)
    assert "11111111" not in str(identity)


def test_a_board_without_dmi_gives_its_device_tree_name_and_never_its_serial(
    tmp_path: Path, programs: Path
) -> None:
    files(
        tmp_path,
        {
            "proc/device-tree/model": "Raspberry Pi 4 Model B Rev 1.4\0",
            "proc/cpuinfo": ARM_CPUINFO + "Hardware\t: BCM2711\nSerial\t\t: 10000000abcdef01\n",
        },
    )

    identity = identify(tmp_path, "linux")

    assert identity["model"] == "Raspberry Pi 4 Model B Rev 1.4"
    assert identity["cpu"] == "BCM2711"
    assert "abcdef01" not in str(identity)


def test_a_mac_is_described_by_sysctl(tmp_path: Path, programs: Path) -> None:
    program(programs, "sysctl", '[ "$2" = hw.model ] && echo MacBookPro18,1 || echo Apple M1 Pro')
    program(programs, "sw_vers", "echo 14.5")

    identity = identify(tmp_path, "darwin")

    assert (identity["model"], identity["cpu"]) == ("MacBookPro18,1", "Apple M1 Pro")
    assert (identity["os"], identity["os_version"]) == ("macOS", "14.5")


def test_windows_is_described_by_named_registry_values() -> None:
    values = {
        "SystemManufacturer": "ASUSTeK COMPUTER INC.",
        "SystemProductName": "T200TA",
        "ProcessorNameString": "Intel(R) Atom(TM) CPU  Z3775  @ 1.46GHz",
        "CurrentBuild": "19045",
        "RegisteredOwner": "somebody",
    }
    identity = _windows(lambda _key, name: values.get(name))

    assert identity["model"] == "T200TA"
    assert identity["cpu"] == "Intel(R) Atom(TM) CPU Z3775 @ 1.46GHz"
    assert identity["board"] is None
    assert "somebody" not in str(identity)


def test_a_machine_that_says_nothing_gives_every_field_all_the_same(tmp_path: Path, programs: Path) -> None:
    identity = identify(tmp_path, "linux")

    assert tuple(identity) == FIELDS
    assert {field for field, value in identity.items() if value} == {"os", "architecture", "cpu_count"}


def test_nothing_of_this_machine_names_its_host_or_user() -> None:
    told = str(list(identify().values()))

    assert len(platform.node()) < 4 or platform.node() not in told
    assert str(Path.home()) not in told


def test_opencl_strings_are_kept_raw_and_printable() -> None:
    device = SimpleNamespace(
        platform=SimpleNamespace(name="ARM Platform\0", version="OpenCL 2.1 v1.r32p1"),
        vendor="ARM",
        name="Mali-T628",
        driver_version="1.1\n",
        version="OpenCL 1.1 " + "x" * 500,
    )

    identity = opencl_identity(device)

    assert identity["opencl_platform"] == "ARM Platform"
    assert identity["opencl_driver"] == "1.1"
    assert len(identity["opencl_version"] or "") == LONGEST


def test_strings_that_real_phones_reported_survive_unchanged(tmp_path: Path, programs: Path) -> None:
    data = os.environ.get("FRONTRUNNER_DATA")
    if data is None:
        pytest.skip("FRONTRUNNER_DATA names no folder with the reported platforms")
    with open(Path(data, "devices/ck_crowdtuning/platform.csv"), newline="", encoding="utf-8") as file:
        names = [row["model"] for row in csv.DictReader(file)]
    ordinary = [name for name in names if name and name.isprintable() and " ".join(name.split()) == name]
    assert len(ordinary) > 300

    for name in ordinary[:: len(ordinary) // 10]:
        files(tmp_path, {"sys/class/dmi/id/product_name": f"{name}\n"})
        assert identify(tmp_path, "linux")["model"] == name


ARM_CPUINFO = """\
processor\t: 0
CPU implementer\t: 0x41
CPU part\t: 0xd05
processor\t: 1
CPU implementer\t: 0x41
CPU part\t: 0xd05
processor\t: 2
CPU implementer\t: 0x41
CPU part\t: 0xd41

"""
