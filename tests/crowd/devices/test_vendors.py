import pytest

from crowd.devices.naming.chips import CPU_VENDOR, OTHER, vendor


@pytest.mark.parametrize(
    ("processor", "expected"),
    [
        ("Mali-G78 r0p1", "Mali"),
        ("QUALCOMM Adreno(TM)", "Adreno"),
        ("NVIDIA GeForce RTX 3060", "NVIDIA"),
        ("Tesla V100-SXM2-16GB", "NVIDIA"),
        ("gfx1030", "Radeon"),
        ("Intel(R) Iris(R) Xe Graphics", "Intel"),
        ("Apple M1 Pro", "Apple"),
        ("PowerVR Rogue GE8320", "PowerVR"),
        ("pthread-Intel(R) Xeon(R) Platinum 8481C CPU @ 2.70GHz", CPU_VENDOR),
        ("cpu-haswell-AMD EPYC 7B12", CPU_VENDOR),
        ("AMD Ryzen 7 5800X 8-Core Processor", CPU_VENDOR),
        ("AMD EPYC", CPU_VENDOR),
        ("Intel Core Ultra 7 155H", CPU_VENDOR),
        ("NVIDIA GPU", "NVIDIA"),
        ("Moore Threads MTT S80", OTHER),
        ("unknown chip", OTHER),
        ("something new", OTHER),
    ],
)
def test_a_driver_s_name_tells_the_family(processor: str, expected: str) -> None:
    assert vendor(processor) == expected


def test_the_gpu_helps_where_the_driver_says_nothing() -> None:
    assert vendor("", "Mali-G57") == "Mali"
    assert vendor("", "") == OTHER


def test_a_chip_that_is_known_to_be_the_processor_is_a_cpu() -> None:
    assert vendor("Apple M1", kind="cpu") == CPU_VENDOR
