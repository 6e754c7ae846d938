"""placeholder until merged"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from crowd.devices.names import text
from crowd.devices.vendors import CPU, vendor


@dataclass(frozen=True)
class Processor:
    name: str
    kind: str


def processor_of(raw: Mapping[str, Any]) -> Processor:
    name = text(raw, "opencl_device")
    return Processor(name or "unknown chip", "cpu" if vendor(name) == CPU else "gpu")
