"""`devices`: the devices that can measure on this machine."""

from __future__ import annotations

import argparse
import contextlib
import sys

from slam.cli.scenes import Commands
from slam.devices.choice import choose_device, list_devices
from slam.devices.device import BACKENDS
from slam.devices.opencl import list_refusals


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser("devices", help="the devices here by backend, best first")
    parser.set_defaults(execute=_devices)


def _devices(_: argparse.Namespace) -> None:
    # Without a device, `choose_device` raises the error that says what to install.
    present = []
    for backend in BACKENDS:
        with contextlib.suppress(ImportError):  # its package is not installed, or does not load here
            present += list_devices(backend)
    for device in present or [choose_device()]:
        sizes = [
            f"{device.compute_units} units" if device.compute_units else "",
            f"{device.global_memory / 2**30:.1f} GiB" if device.global_memory else "",
            f"one buffer up to {device.max_allocation >> 20} MiB",
        ]
        sys.stdout.write(
            f"{device.backend:6} {device.kind:4} {device.label}, {', '.join(filter(None, sizes))}\n"
        )
    for refusal in list_refusals():
        sys.stdout.write(f"cannot be used: {refusal}\n")
