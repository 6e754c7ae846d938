"""The strings with which a device describes itself, cleaned once."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

# Placeholders of firmware whose maker left the field empty.
PLACEHOLDERS = frozenset(
    {
        "", "-", "0", "all series", "by o.e.m.", "default", "default string", "invalid", "n/a", "none",
        "not applicable", "not specified", "null", "o.e.m.", "oem", "system manufacturer",
        "system product name", "system version", "to be filled by o.e.m.", "undefined", "unknown", "xxx",
    }
)  # fmt: skip


@dataclass(frozen=True)
class RawDevice:
    """The strings that identify a model and its driver, each in one line.

    One is empty if the client did not send it, or sent a placeholder or something else than a string.
    """

    architecture: str = ""
    board: str = ""
    board_platform: str = ""
    brand: str = ""
    browser: str = ""
    browser_version: str = ""
    cpu: str = ""
    device: str = ""
    egl: str = ""
    gpu_architecture: str = ""
    gpu_description: str = ""
    gpu_device: str = ""
    gpu_fallback: str = ""
    gpu_vendor: str = ""
    manufacturer: str = ""
    model: str = ""
    model_source: str = ""
    opencl_device: str = ""
    opencl_driver: str = ""
    opencl_platform: str = ""
    os: str = ""
    product: str = ""
    soc_manufacturer: str = ""
    soc_model: str = ""

    @classmethod
    def parse(cls, raw: Mapping[str, Any]) -> "RawDevice":
        """The strings of `raw`, a description as it was sent."""
        return cls(**{name: _one_line(raw[name]) for name in RAW_STRINGS & raw.keys()})

    @property
    def is_browser(self) -> bool:
        """Whether a browser sent them."""
        return bool(self.browser or self.gpu_vendor or self.gpu_architecture)

    @property
    def soc(self) -> str:
        """The maker and the name of the system on a chip."""
        return f"{self.soc_manufacturer} {self.soc_model}".strip()


RAW_STRINGS = frozenset(field.name for field in fields(RawDevice))


def _one_line(value: Any) -> str:
    """The string `value` in one line; empty if it is not a string, or a placeholder."""
    if not isinstance(value, str):
        return ""
    line = " ".join(value.split())
    return "" if line.casefold() in PLACEHOLDERS else line
