"""Chips and drivers by the name people know, out of what drivers and catalogues write."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.devices.naming.chips import graphics, processor, system_on_chip
from crowd.devices.naming.computing import driver
from crowd.devices.naming.raw_device import RawDevice


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
        (("Snapdragon 8 Gen 2",), "Qualcomm Snapdragon 8 Gen 2 (SM8550)"),
        (("Qualcomm MSM 8974 (Flattened Device Tree)",), "Qualcomm Snapdragon 800 (MSM8974)"),
        (("Amlogic AMLS905X4",), "Amlogic S905X4"),
        (("Allwinner A133Pro",), "Allwinner A133 Pro"),
        (("Intel Z3745",), "Intel Atom Z3745"),
        (("", "exotic9000"), ""),
        (("Qualcomm visit-my-site",), ""),
        (("SM8550hello",), ""),
        (("", ""), ""),
    ],
)
def test_a_system_on_a_chip_has_one_name(texts: tuple[str, ...], name: str) -> None:
    assert system_on_chip(*texts) == name


def test_a_board_that_several_chips_share_names_none_of_them() -> None:
    assert system_on_chip("", "lito") == ""


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
        ("Imagination Technologies PowerVR SGX 530", "PowerVR", "PowerVR SGX530"),
        ("4x Imagination Tech BXM 8-256", "PowerVR", "PowerVR BXM-8-256"),
        ("NVIDIA GeForce RTX 3050 Ti Laptop GPU", "NVIDIA", "NVIDIA GeForce RTX 3050 Ti Laptop GPU"),
        ("GeForce GTX 1080", "NVIDIA", "NVIDIA GeForce GTX 1080"),
        ("NVIDIA Corporation GM204 [GeForce GTX 970] (rev a1)", "NVIDIA", "NVIDIA GeForce GTX 970"),
        ("NVIDIA H100 80GB HBM3", "NVIDIA", "NVIDIA H100 80GB HBM3"),
        ("Radeon (TM) RX 480 Graphics", "Radeon", "AMD Radeon RX 480"),
        ("AMD Radeon HD 8240", "Radeon", "AMD Radeon HD 8240"),
        ("gfx1030", "Radeon", "AMD gfx1030"),
        ("Intel(R) Iris(TM) Graphics 540", "Intel", "Intel Iris Graphics 540"),
        ("Intel(R) UHD Graphics 620 [0x3ea0]", "Intel", "Intel UHD Graphics 620"),
        ("Intel HD Graphics 4000", "Intel", "Intel HD Graphics 4000"),
        ("Apple M1 Pro", "Apple", "Apple M1 Pro"),
        ("Samsung Xclipse 920", "Xclipse", "Samsung Xclipse 920"),
        ("Vivante Corporation Vivante GC4000", "Vivante", "Vivante GC4000"),
        ("Vivante GC nanoultra", "Vivante", "Vivante GC Nano Ultra"),
        ("NVIDIA A100-SXM4-40GB", "NVIDIA", "NVIDIA A100 SXM4 40GB"),
        ("NVIDIA H100 80GB HBM3 MIG 1g.10gb", "NVIDIA", "NVIDIA H100 80GB HBM3 MIG 1G.10GB"),
        ("Tesla V100-SXM2-16GB", "NVIDIA", "NVIDIA Tesla V100 SXM2 16GB"),
        ("NVIDIA GeForce GTX 1060 with Max-Q Design", "NVIDIA", "NVIDIA GeForce GTX 1060 Max-Q"),
        ("NVIDIA RTX 6000 Ada Generation", "NVIDIA", "NVIDIA RTX 6000 Ada Generation"),
        ("Quadro RTX 6000", "NVIDIA", "NVIDIA Quadro RTX 6000"),
        ("nvidia visit-my-site", "NVIDIA", "NVIDIA GPU"),
        ("930M Nvidia", "NVIDIA", "NVIDIA GeForce 930M"),
        ("gfx90a:sramecc+:xnack-", "Radeon", "AMD gfx90a"),
        ("AMD Radeon(TM) Graphics", "Radeon", "AMD Radeon Graphics"),
        ("AMD Radeon Pro 5500M Compute Engine", "Radeon", "AMD Radeon Pro 5500M"),
        ("Intel(R) Arc(TM) A770 Graphics", "Intel", "Intel Arc A770"),
        ("Intel(R) Iris(R) Xe Graphics", "Intel", "Intel Iris Xe Graphics"),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "Intel", "Intel UHD Graphics 620"),
        ("Qualcomm(R) Adreno(TM) X1-85 GPU", "Adreno", "Adreno X1-85"),
        (
            "ANGLE (NVIDIA, NVIDIA GeForce RTX 3060 Direct3D11 vs_5_0 ps_5_0, D3D11)",
            "NVIDIA",
            "NVIDIA GeForce RTX 3060",
        ),
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
        "pthread-AMD Ryzen 7 5800H with Radeon Graphics",
        "cpu",
        "default",
        "Somebody's Accelerator",
        "",
    ],
)
def test_what_the_processor_draws_and_what_no_rule_knows_is_not_a_graphics_chip(line: str) -> None:
    assert graphics(line) is None


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("AMD EPYC", "AMD EPYC"),
        ("pthread-AMD EPYC", "AMD EPYC"),
        ("cpu-znver4-AMD EPYC 9654 96-Core Processor", "AMD EPYC 9654"),
        ("cpu-haswell-AMD EPYC 7B12", "AMD EPYC 7B12"),
        ("AMD EPYC-Milan Processor", "AMD EPYC Milan"),
        ("AMD Ryzen 7 5800X 8-Core Processor", "AMD Ryzen 7 5800X"),
        ("AMD Ryzen 7 PRO 5850U with Radeon Graphics", "AMD Ryzen 7 Pro 5850U"),
        ("AMD Ryzen AI 9 HX 370 w/ Radeon 890M", "AMD Ryzen AI 9 HX 370"),
        ("AMD Ryzen Threadripper PRO 5995WX 64-Cores", "AMD Ryzen Threadripper Pro 5995WX"),
        ("AMD Athlon(tm) 64 Processor 3700+", "AMD Athlon 64 3700+"),
        ("AMD FX(tm)-8350 Eight-Core Processor", "AMD FX-8350"),
        ("AMD A6-4400M APU with Radeon(tm) HD Graphics", "AMD A6-4400M"),
        ("Intel(R) Core(TM) i5-2540M CPU @ 2.60GHz", "Intel Core i5-2540M"),
        ("12th Gen Intel(R) Core(TM) i7-1260P", "Intel Core i7-1260P"),
        ("11th Gen Intel(R) Core(TM) i7-1165G7 @ 2.80GHz", "Intel Core i7-1165G7"),
        ("Intel(R) Core(TM) i7 CPU       M 620  @ 2.67GHz", "Intel Core i7 M 620"),
        ("Intel(R) Core(TM)2 Duo CPU     T7500  @ 2.20GHz", "Intel Core 2 Duo T7500"),
        ("Intel(R) Core(TM) Ultra 7 155H", "Intel Core Ultra 7 155H"),
        ("Intel(R) Core(TM) m3-7Y30 CPU @ 1.00GHz", "Intel Core m3-7Y30"),
        ("Intel(R) Xeon(R) CPU E5-2680 v4 @ 2.40GHz", "Intel Xeon E5-2680 v4"),
        ("Intel(R) Xeon(R) Platinum 8370C CPU @ 2.80GHz", "Intel Xeon Platinum 8370C"),
        ("pthread-Intel(R) Xeon(R) Processor @ 2.20GHz", "Intel Xeon"),
        ("Intel(R) Xeon(R) W-2145 CPU @ 3.70GHz", "Intel Xeon W-2145"),
        ("Intel(R) Celeron(R) J4125 CPU @ 2.00GHz", "Intel Celeron J4125"),
        ("Intel(R) Pentium(R) Silver N5000 CPU @ 1.10GHz", "Intel Pentium Silver N5000"),
        ("Intel(R) Atom(TM) x5-Z8350  CPU @ 1.44GHz", "Intel Atom x5-Z8350"),
        ("Intel(R) N100", "Intel N100"),
        ("Apple M3 Max", "Apple M3 Max"),
        ("cpu-cortex-a76", "Arm Cortex-A76"),
        ("Neoverse-N1", "Arm Neoverse N1"),
        ("Ampere Altra Max", "Ampere Altra Max"),
        ("AWS Graviton3", "AWS Graviton3"),
        (
            "Snapdragon(R) X Elite - X1E80100 - Qualcomm(R) Oryon(TM) CPU",
            "Qualcomm Snapdragon X Elite X1E80100",
        ),
        ("BCM2711", "Broadcom BCM2711"),
        ("ARMv7 Processor rev 4 (v7l)", ""),
        ("AMD visit-my-site", ""),
        ("", ""),
    ],
)
def test_a_processor_has_one_name(line: str, name: str) -> None:
    assert processor(line) == name


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
    assert str(driver(RawDevice.parse({"opencl_platform": platform, "opencl_driver": given}))) == name


@pytest.mark.parametrize(
    ("platform", "given"),
    [("Portable Computing Language", "hello 1.2.3.4.5.6.7"), ("NVIDIA CUDA", "555 visit 12345678901")],
)
def test_a_driver_s_version_is_a_version_number_alone(platform: str, given: str) -> None:
    raw = RawDevice(opencl_platform=platform, opencl_driver=given)
    assert driver(raw).version in ("", "555")


@given(st.text(max_size=250))
def test_any_text_is_taken(line: str) -> None:
    processor(line)
    system_on_chip(line)
    graphics(line)
    driver(RawDevice.parse({"opencl_platform": line, "opencl_driver": line}))
