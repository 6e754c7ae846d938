"""Chips and drivers by the name people know, out of what drivers and catalogues write."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.devices.chips import graphics, processor, system_on_chip
from crowd.devices.drivers import driver


@pytest.mark.parametrize(
    ("texts", "name"),
    [
        (("QTI SM8550",), "Qualcomm Snapdragon 8 Gen 2 (SM8550)"),
        (("", "kalama"), "Qualcomm Snapdragon 8 Gen 2 (SM8550)"),
        (("qcom SM8550-AB",), "Qualcomm Snapdragon 8 Gen 2 (SM8550)"),
        (("Qualcomm Technologies, Inc MSM8996",), "Qualcomm Snapdragon 820 (MSM8996)"),
        (("Qualcomm MSM8960",), "Qualcomm MSM8960"),
        (("Mediatek MT6789V/CD",), "MediaTek MT6789V/CD"),
        (("", "mt6765"), "MediaTek MT6765"),
        (("Samsung s5e8535",), "Samsung Exynos 1330 (S5E8535)"),
        (("", "universal9820"), "Samsung Exynos 9820"),
        (("Samsung Exynos 7420",), "Samsung Exynos 7420"),
        (("", "hi3650"), "HiSilicon Kirin 950"),
        (("", "kirin970"), "HiSilicon Kirin 970"),
        (("Google Tensor G3",), "Google Tensor G3"),
        (("", "zuma"), "Google Tensor G3"),
        (("Spreadtrum SC9863A",), "Unisoc SC9863A"),
        (("Spreadtrum T606",), "Unisoc T606"),
        (("Rockchip RK3588",), "Rockchip RK3588"),
        (("", "exotic9000"), "exotic9000"),
        (("", ""), ""),
    ],
)
def test_a_system_on_a_chip_has_one_name(texts: tuple[str, ...], name: str) -> None:
    assert system_on_chip(*texts) == name


def test_a_board_that_several_chips_share_names_none_of_them() -> None:
    assert system_on_chip("", "lito") == "lito"


@pytest.mark.parametrize(
    ("line", "family", "name"),
    [
        ("Qualcomm Adreno (TM) 506", "Adreno", "Adreno 506"),
        ("QUALCOMM Adreno(TM) 650", "Adreno", "Adreno 650"),
        ("Qualcomm Adreno 642l (550 MHz)", "Adreno", "Adreno 642L"),
        ("QUALCOMM Adreno(TM)", "Adreno", "Adreno"),
        ("Mali-G715", "Mali", "Mali-G715"),
        ("2x ARM Mali G68 (950 MHz)", "Mali", "Mali-G68"),
        ("ARM Mali-450 MP", "Mali", "Mali-450"),
        ("Mali T628", "Mali", "Mali-T628"),
        ("12x ARM Immortalis G925", "Mali", "Immortalis-G925"),
        ("Imagination Tech PowerVR GE8320 (650 MHz)", "PowerVR", "PowerVR GE8320"),
        ("Imagination Technologies PowerVR Rogue G6200", "PowerVR", "PowerVR G6200"),
        ("Imagination Technologies PowerVR SGX 530", "PowerVR", "PowerVR SGX 530"),
        ("4x Imagination Tech BXM 8-256", "PowerVR", "PowerVR BXM-8-256"),
        ("NVIDIA GeForce RTX 3050 Ti Laptop GPU", "NVIDIA", "NVIDIA GeForce RTX 3050 Ti Laptop GPU"),
        ("GeForce GTX 1080", "NVIDIA", "NVIDIA GeForce GTX 1080"),
        ("NVIDIA Corporation GM204 [GeForce GTX 970] (rev a1)", "NVIDIA", "NVIDIA GeForce GTX 970"),
        ("NVIDIA H100 80GB HBM3", "NVIDIA", "NVIDIA H100 80GB HBM3"),
        ("Radeon (TM) RX 480 Graphics", "Radeon", "AMD Radeon RX 480 Graphics"),
        ("AMD Radeon HD 8240", "Radeon", "AMD Radeon HD 8240"),
        ("gfx1030", "Radeon", "AMD gfx1030"),
        ("Intel(R) Iris(TM) Graphics 540", "Intel", "Intel Iris Graphics 540"),
        ("Intel(R) UHD Graphics 620 [0x3ea0]", "Intel", "Intel UHD Graphics 620"),
        ("Intel HD Graphics 4000", "Intel", "Intel HD Graphics 4000"),
        ("Apple M1 Pro", "Apple", "Apple M1 Pro"),
        ("Samsung Xclipse 920", "Xclipse", "Samsung Xclipse 920"),
        ("Vivante Corporation Vivante GC4000", "Vivante", "Vivante GC4000"),
        ("Somebody's Accelerator", "", "Somebody's Accelerator"),
    ],
)
def test_a_graphics_chip_has_one_name_and_a_family(line: str, family: str, name: str) -> None:
    chip = graphics(line)

    assert chip is not None
    assert (chip.family, chip.name) == (family, name)


@pytest.mark.parametrize(
    "line",
    [
        "Google Inc. Google SwiftShader",
        "llvmpipe (LLVM 15.0.7, 256 bits)",
        "Android Android PixelFlinger 1.4",
        "InnoTek Systemberatung GmbH VirtualBox Graphics Adapter",
        "pthread-AMD EPYC 7B13",
        "cpu",
        "default",
        "",
    ],
)
def test_what_the_processor_draws_is_no_graphics_chip(line: str) -> None:
    assert graphics(line) is None


def test_a_processor_loses_clocks_and_marks() -> None:
    assert processor("Intel(R) Core(TM) i5-2540M CPU @ 2.60GHz") == "Intel Core i5-2540M"


@pytest.mark.parametrize(
    ("platform", "given", "name"),
    [
        ("ARM Platform", "3.0 v1.r44p1-00eac0.ae7c4ac6a4cb9bfcf63f4dcec1e0b4d1", "Mali r44p1"),
        (
            "QUALCOMM Snapdragon(TM)",
            "OpenCL 2.0 QUALCOMM build: commit #2c58b2b changeid # Date: 11/30/20 Mon Compiler E031.37.12.07",
            "Adreno E031.37.12.07",
        ),
        ("NVIDIA CUDA", "560.35.03", "NVIDIA 560.35.03"),
        ("Portable Computing Language", "7.0", "PoCL 7.0"),
        ("Intel(R) OpenCL Graphics", "24.35.30872", "Intel 24.35.30872"),
        ("AMD Accelerated Parallel Processing", "3602.0 (HSA1.1,LC)", "AMD 3602.0"),
        ("Apple", "1.2 1.0", "Apple 1.2"),
        ("Somebody's platform", "9", ""),
        ("", "", ""),
    ],
)
def test_a_driver_is_its_maker_and_release(platform: str, given: str, name: str) -> None:
    assert str(driver({"opencl_platform": platform, "opencl_driver": given})) == name


@given(st.text(max_size=250))
def test_any_text_is_taken(line: str) -> None:
    processor(line)
    driver({"opencl_platform": line, "opencl_driver": line})
    assert system_on_chip(line) or not line
    chip = graphics(line)
    assert chip is None or chip.name
