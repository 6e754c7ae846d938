"""Who computed: one name for each chip."""

import pytest

from crowd.devices.naming.chips import Processor
from crowd.devices.naming.computing import processor_of
from crowd.devices.naming.raw_device import RawDevice

POCL = "Portable Computing Language"


@pytest.mark.parametrize(
    ("platform", "device", "cpu", "name", "kind"),
    [
        (POCL, "pthread-AMD EPYC", "AMD EPYC", "AMD EPYC", "cpu"),
        (POCL, "cpu-znver4-AMD EPYC 9654 96-Core Processor", None, "AMD EPYC 9654", "cpu"),
        (POCL, "cpu", "AMD EPYC 7B13", "AMD EPYC 7B13", "cpu"),
        (POCL, "pthread-Apple M1", None, "Apple M1", "cpu"),
        (POCL, "pthread-visit my site", "hello", "unknown chip", "cpu"),
        (POCL, "NVIDIA GeForce RTX 3060", None, "NVIDIA GeForce RTX 3060", "gpu"),
        (
            "Intel(R) CPU Runtime for OpenCL(TM) Applications",
            "Intel(R) Xeon(R) CPU",
            None,
            "Intel Xeon",
            "cpu",
        ),
        ("Intel(R) OpenCL", "12th Gen Intel(R) Core(TM) i7-1260P", None, "Intel Core i7-1260P", "cpu"),
        ("rusticl", "llvmpipe (LLVM 15.0.6, 256 bits)", "AMD Ryzen 5 3600", "AMD Ryzen 5 3600", "cpu"),
        ("Vulkan", "llvmpipe (LLVM 15.0.7, 256 bits)", "AMD EPYC 7B13", "AMD EPYC 7B13", "cpu"),
        ("Vulkan", "SwiftShader Device (Subzero)", None, "unknown chip", "cpu"),
        ("Vulkan", "Microsoft Basic Render Driver", "AMD EPYC 7B13", "AMD EPYC 7B13", "cpu"),
        ("Vulkan", "lavapipe", None, "unknown chip", "cpu"),
        ("Intel(R) OpenCL", "QEMU Virtual CPU version 2.5+", None, "unknown chip", "cpu"),
        ("AMD Accelerated Parallel Processing", "Common KVM processor", None, "unknown chip", "cpu"),
        ("wasmtime", "AMD EPYC 7B13", "AMD EPYC 7B13", "AMD EPYC 7B13", "cpu"),
        ("wasmtime", "aarch64", None, "unknown chip", "cpu"),
        ("Apple", "Apple M1 Pro", "Apple M1 Pro", "Apple M1 Pro", "gpu"),
        ("NVIDIA CUDA", "NVIDIA GeForce RTX 3060", "AMD EPYC", "NVIDIA GeForce RTX 3060", "gpu"),
        ("QUALCOMM Snapdragon(TM)", "QUALCOMM Adreno(TM)", None, "Adreno", "gpu"),
        ("Somebody's platform", "Somebody's chip", "AMD EPYC", "unknown chip", "gpu"),
        (None, None, None, "unknown chip", "gpu"),
    ],
)
def test_the_chip_that_computed(
    platform: str | None, device: str | None, cpu: str | None, name: str, kind: str
) -> None:
    found = processor_of(RawDevice.parse({"opencl_platform": platform, "opencl_device": device, "cpu": cpu}))

    assert found == Processor(name, kind)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "described",
    [
        {"opencl_platform": "Vulkan", "opencl_device": None, "opencl_driver": "llvmpipe Mesa 23.2.1"},
        {"gpu_description": "llvmpipe (LLVM 15.0.7, 256 bits)"},
        {"gpu_device": "SwiftShader Device (Subzero)"},
        {"gpu_vendor": "llvmpipe"},
        {"gpu_fallback": "true"},
    ],
)
def test_a_software_renderer_computes_on_the_processor_wherever_it_is_named(
    described: dict[str, str | None],
) -> None:
    assert processor_of(RawDevice.parse(described)).kind == "cpu"


def test_a_phone_s_processor_is_its_system_on_a_chip() -> None:
    raw = {"opencl_platform": POCL, "opencl_device": "cpu", "soc_model": "SM8550", "cpu": "AArch64 Processor"}

    assert processor_of(RawDevice.parse(raw)) == Processor("Qualcomm Snapdragon 8 Gen 2 (SM8550)", "cpu")
