"""What a device says of itself, on machines played by a fake root folder and fake programs on PATH."""

import csv
import os
import platform
from pathlib import Path
from types import SimpleNamespace

import pytest

from client_kit.device.description import (
    ANDROID_PROPERTIES,
    FIELDS,
    _windows,
    identify,
    opencl_identity,
    processor_identity,
)
from client_kit.device.sources import LONGEST_TEXT
from crowd.results.intake.checks import check_device
from slam.devices import wasm
from slam.devices.device import Device
from tests.client_kit.machines import files, getprop, program

GALAXY = {
    "ro.build.version.release": "14",
    "ro.product.manufacturer": "samsung",
    "ro.product.brand": "samsung",
    "ro.product.model": "SM-A166B",
    "ro.product.device": "a16x",
    "ro.product.board": "s5e8535",
    "ro.hardware": "s5e8535",
    "ro.soc.manufacturer": "Samsung",
    "ro.soc.model": "s5e8535",
    "ro.board.platform": "erd8535",
    "ro.hardware.egl": "mali",
    "ro.serialno": "R58N12345XX",
    "ro.boot.serialno": "R58N12345XX",
}


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
DMI = "sys/class/dmi/id"
PC = {
    "etc/os-release": "NAME='Ubuntu'\nVERSION_ID=\"24.04\"\n",
    f"{DMI}/sys_vendor": "LENOVO\n",
    f"{DMI}/product_name": "20XW004AGE\n",
    f"{DMI}/product_serial": "PF2ABCDE\n",
    f"{DMI}/product_uuid": "11111111-2222-3333-4444-555555555555\n",
    "proc/cpuinfo": "processor\t: 0\nmodel name\t: 11th Gen Intel(R) Core(TM) i7-1165G7 @ 2.80GHz\n",
}
BOARD = {
    "proc/device-tree/model": "Raspberry Pi 4 Model B Rev 1.4\0",
    "proc/cpuinfo": f"{ARM_CPUINFO}Hardware\t: BCM2711\nSerial\t\t: 10000000abcdef01\n",
}
WINDOWS = {
    "SystemManufacturer": "ASUSTeK COMPUTER INC.",
    "SystemProductName": "T200TA",
    "ProcessorNameString": "Intel(R) Atom(TM) CPU  Z3775  @ 1.46GHz",
    "CurrentBuild": "19045",
    "RegisteredOwner": "somebody",
}


def assert_said(
    identity: dict[str, str | None], secrets: tuple[str, ...] = (), /, **fields: str | None
) -> None:
    """`identity` has these `fields`, and none of the `secrets` that the machine holds, too."""
    assert {name: identity[name] for name in fields} == fields
    assert not [secret for secret in secrets if secret in str(identity)]


@pytest.mark.parametrize(
    ("contents", "properties", "secrets", "fields"),
    [
        (
            {"proc/cpuinfo": ARM_CPUINFO},
            GALAXY,
            ("R58N12345XX",),
            {field: GALAXY[key] for field, key in ANDROID_PROPERTIES.items()}
            | {"os": "Android", "cpu_parts": "0x41:0xd05 0x41:0xd41", "cpu_count": "3"},
        ),
        (
            {},
            {"ro.product.model": "Pixel 8"},
            (),
            {"model": "Pixel 8", "soc_model": None, "manufacturer": None},
        ),
        (
            PC,
            {},
            ("PF2ABCDE", "11111111"),
            {
                **{"manufacturer": "LENOVO", "model": "20XW004AGE", "os": "Ubuntu", "os_version": "24.04"},
                "cpu": "11th Gen Intel(R) Core(TM) i7-1165G7 @ 2.80GHz",
            },
        ),
        (BOARD, {}, ("abcdef01",), {"model": "Raspberry Pi 4 Model B Rev 1.4", "cpu": "BCM2711"}),
    ],
    ids=["a phone", "a phone that hides properties", "a PC by DMI", "a board by its device tree"],
)
def test_linux_is_described_by_named_files_and_properties_and_never_by_a_serial_number(
    contents: dict[str, str],
    properties: dict[str, str],
    secrets: tuple[str, ...],
    fields: dict[str, str | None],
    tmp_path: Path,
    programs: Path,
) -> None:
    files(tmp_path, contents)
    if properties:
        getprop(programs, properties)

    assert_said(identify(tmp_path, "linux"), secrets, **fields)


def test_a_getprop_that_fails_is_not_an_android(tmp_path: Path, programs: Path) -> None:
    program(programs, "getprop", "exit 1")
    files(tmp_path, {"etc/os-release": 'NAME="Debian GNU/Linux"\nVERSION_ID="12"\n'})

    assert_said(identify(tmp_path, "linux"), os="Debian GNU/Linux")


def test_a_mac_is_described_by_sysctl(tmp_path: Path, programs: Path) -> None:
    program(programs, "sysctl", '[ "$2" = hw.model ] && echo MacBookPro18,1 || echo Apple M1 Pro')
    program(programs, "sw_vers", "echo 14.5")

    identity = identify(tmp_path, "darwin")

    assert_said(identity, os="macOS", os_version="14.5", model="MacBookPro18,1", cpu="Apple M1 Pro")


def test_windows_is_described_by_named_registry_values() -> None:
    identity = _windows(lambda _key, name: WINDOWS.get(name))

    assert_said(
        identity, ("somebody",), model="T200TA", cpu="Intel(R) Atom(TM) CPU Z3775 @ 1.46GHz", board=None
    )


def test_a_machine_that_says_nothing_gives_every_field_all_the_same(tmp_path: Path, programs: Path) -> None:
    identity = identify(tmp_path, "linux")

    assert tuple(identity) == FIELDS
    assert {field for field, value in identity.items() if value} == {"os", "architecture", "cpu_count"}


def test_nothing_of_this_machine_names_its_host_or_user() -> None:
    description = str(list(identify().values()))

    assert len(platform.node()) < 4 or platform.node() not in description
    assert str(Path.home()) not in description


def test_opencl_strings_are_kept_raw_and_printable() -> None:
    described = {"vendor": "ARM", "name": "Mali-T628", "driver_version": "1.1\n"}
    arm = SimpleNamespace(name="ARM Platform\0", version="OpenCL 2.1 v1.r32p1")
    device = SimpleNamespace(platform=arm, version="OpenCL 1.1 " + "x" * 500, **described)

    identity = opencl_identity(device)

    assert identity["opencl_platform"] == "ARM Platform"
    assert identity["opencl_driver"] == "1.1"
    assert len(identity["opencl_version"] or "") == LONGEST_TEXT


def test_over_webgpu_the_adapter_is_named_in_the_same_fields() -> None:
    adapter = Device(
        backend="webgpu",
        platform="Vulkan (wgpu-native 27)",
        version="wgpu-py 0.31",
        name="Mali-G68",
        driver="v1.r38p1",
        kind="gpu",
        compute_units=0,
        max_allocation=2**27,
        global_memory=0,
        double_precision=False,
        handle=None,
    )

    identity = processor_identity(adapter)

    assert set(identity) == {field for field in FIELDS if field.startswith("opencl_")}
    assert_said(identity, opencl_device="Mali-G68", opencl_driver="v1.r38p1", opencl_vendor=None)
    assert_said(identity, opencl_platform="Vulkan (wgpu-native 27)", opencl_version=None)


def test_over_webassembly_the_processor_alone_is_named() -> None:
    [device] = wasm.list_devices()

    identity = identify(processor=processor_identity(device))

    assert device.name in (identity["cpu"], platform.processor(), platform.machine())
    assert {field for field in FIELDS if field.startswith("opencl_") and identity[field] is not None} == set()


def reported(file: str, *columns: str) -> list[tuple[str, ...]]:
    """The distinct values of `columns` in `file` of the devices that others collected."""
    data = os.environ.get("FRONTRUNNER_DATA")
    if data is None:
        pytest.skip("FRONTRUNNER_DATA names no folder with the reported devices")
    with open(Path(data, "devices", file), newline="", encoding="utf-8") as rows:
        return sorted({tuple(row[column] for column in columns) for row in csv.DictReader(rows)})


def one_line(text: str) -> str | None:
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:LONGEST_TEXT] or None


@pytest.mark.slow
def test_what_volunteers_phones_reported_arrives_as_they_wrote_it_and_is_taken(tmp_path: Path) -> None:
    machines = reported("ck_crowdtuning/platform.csv", "model", "vendor")
    processors = [name for (name,) in reported("ck_crowdtuning/platform.cpu.csv", "name")]
    chips = [name for (name,) in reported("ck_crowdtuning/platform.gpu.csv", "name")]
    assert min(len(machines), len(processors), len(chips)) > 50

    for number, (model, vendor) in enumerate(machines):
        cpu, gpu = processors[number % len(processors)], chips[number % len(chips)]
        files(tmp_path, {f"{DMI}/product_name": f"{model}\n", f"{DMI}/sys_vendor": f"{vendor}\n"})
        files(tmp_path, {"proc/cpuinfo": f"processor\t: 0\nmodel name\t: {cpu}\n"})
        opencl = SimpleNamespace(
            platform=SimpleNamespace(name="a platform", version="OpenCL 2.0"),
            vendor="a vendor", name=gpu, driver_version="1", version="OpenCL 2.0",
        )  # fmt: skip

        identity = identify(tmp_path, "linux", opencl_identity(opencl))

        values = [identity[field] for field in ("model", "manufacturer", "cpu", "opencl_device")]
        assert values == [one_line(text) for text in (model, vendor, cpu, gpu)]
        check_device(identity)


@pytest.mark.slow
def test_getprop_identifies_phones_across_the_play_catalogue(tmp_path: Path, programs: Path) -> None:
    rows = reported(
        "play_catalog/android-devices-catalog.csv", "Manufacturer", "Brand", "Device", "System on Chip"
    )
    by_maker = {maker: (brand, name, soc) for maker, brand, name, soc in rows}
    assert len(by_maker) > 300

    for maker, (brand, name, soc) in sorted(by_maker.items())[:: len(by_maker) // 25]:
        said = [text.replace("'", "") for text in (maker, brand, name, soc)]
        keys = ("ro.product.manufacturer", "ro.product.brand", "ro.product.device", "ro.soc.model")
        getprop(programs, dict(zip(keys, said, strict=True)))

        identity = identify(tmp_path, "linux")

        values = [identity[field] for field in ("manufacturer", "brand", "device", "soc_model")]
        assert values == [one_line(text) for text in said]
        check_device(identity)


def test_a_terminal_without_androids_programs_on_its_path_finds_getprop(
    tmp_path: Path, programs: Path
) -> None:
    getprop(tmp_path / "system/bin", GALAXY)

    assert identify(tmp_path, "linux")["model"] == "SM-A166B"


def test_clocks_of_the_clusters_and_the_memory_sold_are_reported(tmp_path: Path, programs: Path) -> None:
    clocks = {0: 1804800, 1: 1804800, 2: 2400000, 3: 2841600}
    files(
        tmp_path,
        {f"sys/devices/system/cpu/cpu{n}/cpufreq/cpuinfo_max_freq": f"{f}\n" for n, f in clocks.items()}
        | {"proc/meminfo": "MemTotal:        7825412 kB\nMemFree:  1 kB\n"},
    )

    identity = identify(tmp_path, "linux")

    assert (identity["cpu_max_mhz"], identity["memory_gib"]) == ("1805 2400 2842", "8")
