"""Whatever a stranger writes, only words of our own tables come out where the public reads."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from crowd.devices.naming import chips, names
from crowd.devices.naming.computing import driver, processor_of
from crowd.devices.naming.identity import identify
from crowd.devices.naming.names import SERIES
from crowd.devices.naming.raw_device import RawDevice

NAMING = Path(chips.__file__).parent
TABLES = (*NAMING.glob("tables/*.toml"), *(NAMING / f"{name}.py" for name in ("computing", "identity")))
RUN = re.compile(r"[^\W\d_]{4,}")
OURS = {run.casefold() for path in TABLES for run in RUN.findall(path.read_text(encoding="utf-8"))}
# Codes whose form is fixed, and whose letters are not: MT6833V/MNZA, 20ALCTO1WW.
CODES = re.compile(r"[acdhmnpt]{1,2}za|[a-z]{1,2}cto", re.IGNORECASE)

STARTS = (
    "NVIDIA", "GeForce RTX", "Quadro", "Tesla", "AMD Radeon", "Radeon RX", "gfx", "Intel(R)", "Intel Arc",
    "Iris(R) Xe", "UHD Graphics", "Mali-G", "Immortalis-G", "QUALCOMM Adreno(TM)", "PowerVR Rogue",
    "Apple M", "Vivante GC", "V3D", "Core(TM) i7-", "Core Ultra 7", "Xeon(R) Platinum", "Celeron",
    "Pentium Gold", "Atom x5-", "AMD EPYC", "AMD Ryzen 7", "Athlon 64", "Cortex-A", "Snapdragon X",
    "Snapdragon 8", "pthread-", "cpu-znver4-", "QTI SM", "MT6789V/", "MediaTek", "Exynos", "Kirin",
    "Tensor", "Unisoc T", "RK", "Allwinner A", "Amlogic S", "SM-S", "GT-I", "CPH", "XQ-", "LG-", "NXT-L",
    "iPhone", "Compiler E0", "v1.r", "(", ")", "/", "_", "@", "[", "]",
)  # fmt: skip
MODELS = tuple(f"{word} " for series in SERIES.values() for word in series)
PLATFORMS = (
    "ARM Platform",
    "QUALCOMM",
    "Portable Computing Language",
    "NVIDIA CUDA",
    "Intel",
    "AMD",
    "Apple",
)
PIECES = st.one_of(
    st.sampled_from(STARTS + MODELS),
    st.text("abcdefghijklmnopqrstuvwxyzABCDEF", min_size=1, max_size=9),
    st.text("0123456789.-+", min_size=1, max_size=6),
    st.sampled_from((" ", " ", "-")),
    st.text(max_size=5),
)
LINES = st.lists(PIECES, max_size=7).map("".join)
MAKERS = st.sampled_from(sorted(names.LISTED)) | LINES


def strangers(text: str) -> list[str]:
    """The words of four letters or more in `text` that are in none of our tables."""
    words = (run.casefold() for run in RUN.findall(text))
    return [word for word in words if word not in OURS and not CODES.fullmatch(word)]


def public_texts(raw: dict[str, Any]) -> Iterator[str]:
    yield processor_of(RawDevice.parse(raw)).name
    yield str(driver(RawDevice.parse(raw)))
    identity = identify(raw)
    yield from (identity.cpu, identity.soc, identity.gpu, identity.os, identity.kind)
    # An address of a device that no rule names ends with a digest.
    yield re.sub(r"-[0-9a-f]{8}$", "", identity.slug)
    if identity.named:
        yield from (identity.manufacturer, identity.name)


@given(LINES)
@example("nvidia visit-my-site")
@example("GeForce RTX 4090 visit my site")
@example("Snapdragon 8 visit my site")
@example("Qualcomm visit")
@example("Intel Core visit-my-site")
def test_no_stranger_s_word_is_in_a_chip(line: str) -> None:
    chip = chips.graphics(line)
    texts = (chips.processor(line), chips.system_on_chip(line), chip.name if chip else "")

    assert [strangers(text) for text in texts] == [[], [], []]


@given(LINES)
def test_a_chip_s_name_is_understood_again(line: str) -> None:
    """So a name that was derived once is the same when it is derived from the name."""
    chip = chips.graphics(line)

    assert chip is None or chips.graphics(chip.name) == chip
    assert chips.processor(chips.processor(line)) == chips.processor(line)


@pytest.mark.slow
@given(
    st.fixed_dictionaries(
        {
            "os": st.sampled_from(["Android", "Debian GNU/Linux", "macOS", "Windows"]) | LINES,
            "manufacturer": MAKERS,
            "model": LINES,
            "cpu": LINES,
            "soc_model": LINES,
            "board_platform": LINES,
            "egl": LINES,
            "device": LINES,
            "opencl_platform": st.sampled_from(PLATFORMS) | LINES,
            "opencl_device": LINES,
            "opencl_driver": LINES,
        }
    )
)
@example({"os": "Android", "manufacturer": "Google", "model": "Pixel visit"})
@example({"os": "Linux", "manufacturer": "Visit", "model": "My Site", "cpu": "AMD EPYC"})
@example({"os": "Linux", "manufacturer": "Dell", "model": "Visit", "cpu": "Hello World"})
@example({"manufacturer": "Visit My Site"})
@example({"manufacturer": "Simulated", "model": "phone 1 (visit-like)"})
def test_no_stranger_s_word_is_shown_to_the_public(raw: dict[str, Any]) -> None:
    assert {text: found for text in public_texts(raw) if (found := strangers(text))} == {}
