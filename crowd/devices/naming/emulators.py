"""Detection of phone emulators and virtual machines in raw strings.

An emulator computes on another machine than it reports, so its figures do not describe the model. A virtual
machine of a PC runs on the processor that it reports, so its figures count; it is only marked.
"""

import re

from crowd.devices.naming.raw_device import RawDevice

FIELDS = (
    "manufacturer", "brand", "model", "device", "product", "board", "board_platform", "soc_model", "egl",
    "cpu", "opencl_device",
)  # fmt: skip
EMULATOR = re.compile(
    r"goldfish|ranchu|sdk_gphone|google_sdk|sdk built for|generic_x86|vbox86|genymotion|bluestacks|bignox|"
    r"\bnox\b|droid4x|\bttvm|\bmumu|ldplayer|\bmemu\b|android on emulator|\bemulator\b|gce[ _]x86|\bvsoc|"
    r"cuttlefish|\bcvd_|appcrawler|virtualbox|qemu|vmware",
    re.IGNORECASE,
)
# Whole names of the SDK's images; a name that only begins with one is a device.
WHOLE = frozenset({"sdk", "sdk_x86", "emu64x", "emu64xa", "emu64a"})
# A program for ARM reads the name of a PC's processor where qemu's user mode runs it.
ARM = re.compile(r"aarch64|arm", re.IGNORECASE)
PC_PROCESSOR = re.compile(r"intel\(r\)|xeon|ryzen|epyc|threadripper", re.IGNORECASE)
# Emulated processors.
EMULATED_PROCESSOR = re.compile(r"qemu (virtual|tcg)|\btcg\b|\bbochs\b", re.IGNORECASE)
VIRTUAL_MACHINE = re.compile(
    r"virtualbox|innotek|vmware|qemu|\bkvm\b|bochs|parallels|bhyve|openstack|hvm domu|\bxen\b|"
    r"standard pc \(|virtual machine|google compute engine|amazon ec2",
    re.IGNORECASE,
)


def is_emulator(raw: RawDevice, handheld: bool) -> bool:
    """Whether `raw` is an emulated phone (`handheld`), or a PC with an emulated processor."""
    if not handheld:
        is_arm_on_pc = ARM.match(raw.architecture) and PC_PROCESSOR.search(raw.cpu)
        return bool(is_arm_on_pc or EMULATED_PROCESSOR.search(raw.cpu))
    strings = [getattr(raw, field) for field in FIELDS]
    return any(EMULATOR.search(line) or line.casefold() in WHOLE for line in strings)


def is_virtual_machine(raw: RawDevice) -> bool:
    """Whether the firmware of a PC names a hypervisor."""
    return any(VIRTUAL_MACHINE.search(line) for line in (raw.manufacturer, raw.model, raw.board))
