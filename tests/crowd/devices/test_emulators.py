"""What is not a device of its own."""

import pytest

from crowd.devices.naming.identity import DEVICE, EMULATOR, UNKNOWN_DEVICE, VIRTUAL, identify


@pytest.mark.parametrize(
    "strings",
    [
        {"manufacturer": "Google", "model": "sdk_gphone64_arm64", "board_platform": ""},
        {"manufacturer": "unknown", "model": "Android SDK built for x86_64"},
        {"manufacturer": "Google", "model": "Pixel 8", "board": "goldfish_x86_64"},
        {"manufacturer": "Samsung", "model": "SM-G930F", "board_platform": "ranchu"},
        {"manufacturer": "Samsung", "model": "SM-G930F", "device": "generic_x86"},
        {"manufacturer": "Genymotion", "model": "Nexus 5"},
        {"manufacturer": "BlueStacks", "model": "BlueStacks"},
        {"manufacturer": "UNKNOWN", "model": "FULL ANDROID ON EMULATOR"},
        {"manufacturer": "UNKNOWN", "model": "GCE X86 PHONE"},
        {"manufacturer": "innotek GmbH", "model": "VirtualBox"},
        {"manufacturer": "Unknown", "model": "sdk"},
    ],
)
def test_an_emulated_phone_is_an_emulator(strings: dict[str, str]) -> None:
    identity = identify({"os": "Android", **strings})

    assert identity.kind == EMULATOR


@pytest.mark.parametrize(
    "strings",
    [
        {"manufacturer": "innotek GmbH", "model": "VirtualBox", "cpu": "Intel(R) Core(TM) i7-8550U"},
        {"manufacturer": "QEMU", "model": "Standard PC (Q35 + ICH9, 2009)", "cpu": "AMD EPYC 7B13"},
        {"manufacturer": "VMware, Inc.", "model": "VMware Virtual Platform", "cpu": "Intel Xeon"},
        {"manufacturer": "Microsoft Corporation", "model": "Virtual Machine", "cpu": "Intel Xeon"},
        {"manufacturer": "Xen", "model": "HVM domU", "cpu": "Intel Xeon"},
    ],
)
def test_a_pcs_virtual_machine_is_marked_and_counts(strings: dict[str, str]) -> None:
    identity = identify({"os": "Debian GNU/Linux", **strings})

    assert identity.kind == VIRTUAL


def test_an_emulated_processor_is_an_emulator_on_a_pc_too() -> None:
    emulated = identify({"os": "Linux", "manufacturer": "QEMU", "cpu": "QEMU Virtual CPU version 2.5+"})

    assert emulated.kind == EMULATOR


@pytest.mark.parametrize(
    ("architecture", "cpu", "emulator"),
    [
        ("aarch64", "Intel(R) Xeon(R) Processor", True),
        ("armv7l", "AMD Ryzen 7 5800X 8-Core Processor", True),
        ("x86_64", "Intel(R) Xeon(R) Processor", False),
        ("AMD64", "Intel(R) Core(TM) i7-8550U", False),
        ("aarch64", "AMD Opteron A1170", False),
        ("aarch64", "Neoverse-N1", False),
        ("", "Intel(R) Xeon(R) Processor", False),
    ],
)
def test_arm_programs_on_a_pcs_processor_run_in_an_emulator(
    architecture: str, cpu: str, emulator: bool
) -> None:
    description = {"os": "Debian GNU/Linux", "architecture": architecture, "cpu": cpu}

    assert (identify(description).kind == EMULATOR) is emulator


@pytest.mark.parametrize(
    ("maker", "model"),
    [("ALPS", "E5533"), ("OPPO", "MSM8916 for arm64"), ("unknown", "generic_a53_32"), ("", ""), ("HTC", "")],
)
def test_names_of_a_chip_makers_kit_are_unknown_devices(maker: str, model: str) -> None:
    assert identify({"os": "Android", "manufacturer": maker, "model": model}).kind == UNKNOWN_DEVICE


@pytest.mark.parametrize(
    ("maker", "model"), [("Nokia", "Nokia 6.1"), ("Samsung", "SM-N9005"), ("ANDY", "Android One X")]
)
def test_an_ordinary_phone_is_a_device(maker: str, model: str) -> None:
    assert identify({"os": "Android", "manufacturer": maker, "model": model}).kind == DEVICE
