"""Families of devices in common use: their descriptions and approximate speeds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Family:
    """Devices with the chips of one maker, oldest first.

    `level`: time of a frame relative to the reference device, in the middle of the family. `spread`: standard
    deviation of its logarithm. `fixed`: time of a frame that no configuration saves (transfers, launches),
    relative to the slowest configuration. `share`: of the crowd.
    """

    name: str
    form: str
    share: float
    level: float
    spread: float
    fixed: float
    os: str
    os_versions: tuple[str, ...]
    platform: str
    drivers: tuple[str, ...]  # each with the version of the operating system at its place
    chips: tuple[str, ...]
    socs: tuple[str, ...] = ()
    cpus: tuple[str, ...] = ()
    adapters: tuple[tuple[str, str], ...] = ()  # maker and architecture of each chip, as browsers name them
    throttles: float = 0.0  # share of its devices


ANDROID = ("13", "14", "15", "16")
FAMILIES = (
    Family(
        name="Adreno", form="phone", share=0.28, level=3.0, spread=0.45, fixed=0.10,
        os="Android", os_versions=ANDROID, platform="QUALCOMM Snapdragon(TM)",
        drivers=(
            "OpenCL 2.0 QUALCOMM build: commit #1 Compiler E031.37.12.07",
            "OpenCL 3.0 QUALCOMM build: commit #2 Compiler E031.41.03.36",
            "OpenCL 3.0 QUALCOMM build: commit #3 Compiler E031.45.02.10",
        ),
        chips=(
            "QUALCOMM Adreno(TM) 540", "QUALCOMM Adreno(TM) 640", "QUALCOMM Adreno(TM) 660",
            "QUALCOMM Adreno(TM) 740", "QUALCOMM Adreno(TM) 830",
        ),
        socs=("QTI MSM8998", "QTI SM8150", "QTI SM8350", "QTI SM8550", "QTI SM8750"), throttles=0.2,
        adapters=tuple(("qualcomm", f"adreno-{series}xx") for series in (5, 6, 6, 7, 8)),
    ),
    Family(
        name="Mali", form="phone", share=0.26, level=4.0, spread=0.5, fixed=0.14,
        os="Android", os_versions=ANDROID, platform="ARM Platform",
        drivers=("2.1 v1.r26p0", "3.0 v1.r38p1", "3.0 v1.r44p1"),
        chips=("Mali-T880", "Mali-G57", "Mali-G610", "Mali-G78", "Mali-G715", "Mali-G925"),
        socs=(
            "Samsung Exynos 8890", "Mediatek MT6833", "Mediatek MT6895", "Google Tensor", "Google Tensor G3",
            "Mediatek MT6991",
        ),
        throttles=0.25,
        adapters=tuple(
            ("arm", name) for name in ("midgard", "valhall", "valhall", "valhall", "valhall", "gen-5")
        ),
    ),
    Family(
        name="PowerVR", form="phone", share=0.06, level=6.0, spread=0.4, fixed=0.18,
        os="Android", os_versions=ANDROID, platform="PowerVR", drivers=("1.15@6133109", "1.17@6210866"),
        chips=("PowerVR Rogue GE8320", "PowerVR Rogue GM9446", "PowerVR B-Series BXM-8-256"),
        socs=("Mediatek MT6765", "Mediatek MT6779", "Mediatek MT6855"), throttles=0.15,
        adapters=(("img-tec", "rogue"),) * 3,
    ),
    Family(
        name="Xclipse", form="phone", share=0.05, level=2.2, spread=0.3, fixed=0.10,
        os="Android", os_versions=ANDROID, platform="Samsung", drivers=("2.2.0", "2.4.1"),
        chips=("Samsung Xclipse 540", "Samsung Xclipse 940"),
        socs=("Samsung Exynos 1480", "Samsung Exynos 2400"), throttles=0.2,
        adapters=(("samsung", "rdna-2"), ("samsung", "rdna-3")),
    ),
    Family(
        name="NVIDIA", form="laptop", share=0.12, level=0.25, spread=0.5, fixed=0.06, os="Windows 11",
        os_versions=("22631", "26100"), platform="NVIDIA CUDA", drivers=("551.86", "560.94", "572.16"),
        chips=(
            "NVIDIA GeForce GTX 1650", "NVIDIA GeForce RTX 2060", "NVIDIA GeForce RTX 3060",
            "NVIDIA GeForce RTX 4070",
        ),
        cpus=(
            "Intel(R) Core(TM) i5-10300H", "Intel(R) Core(TM) i7-10750H", "AMD Ryzen 7 5800H",
            "Intel(R) Core(TM) i7-13700H",
        ),
    ),
    Family(
        name="Radeon", form="PC", share=0.08, level=0.35, spread=0.5, fixed=0.07, os="Ubuntu 24.04",
        os_versions=("22.04", "24.04"), platform="AMD Accelerated Parallel Processing",
        drivers=("3581.0", "3625.0"),
        chips=("AMD Radeon RX 580", "AMD Radeon RX 6600", "AMD Radeon RX 7800 XT"),
        cpus=("AMD Ryzen 5 3600", "AMD Ryzen 5 5600X", "AMD Ryzen 7 7700X"),
    ),
    Family(
        name="Intel", form="laptop", share=0.10, level=1.2, spread=0.35, fixed=0.08, os="Fedora Linux 41",
        os_versions=("40", "41"), platform="Intel(R) OpenCL Graphics", drivers=("24.35.30872", "25.05.32567"),
        chips=(
            "Intel(R) HD Graphics 530", "Intel(R) UHD Graphics 620", "Intel(R) Iris(R) Xe Graphics",
            "Intel(R) Arc(TM) A770 Graphics",
        ),
        cpus=(
            "Intel(R) Core(TM) i7-6700HQ", "Intel(R) Core(TM) i5-8250U", "Intel(R) Core(TM) i7-1260P",
            "Intel(R) Core(TM) i7-12700K",
        ),
        throttles=0.1,
    ),
    Family(
        name="CPU", form="PC", share=0.05, level=1.5, spread=0.4, fixed=0.04, os="Debian GNU/Linux 13",
        os_versions=("12", "13"), platform="Portable Computing Language", drivers=("5.0", "6.0"),
        chips=("cpu-haswell-Intel(R) Core(TM) i7-4790", "cpu-znver3-AMD Ryzen 7 5700G"),
        cpus=("Intel(R) Core(TM) i7-4790", "AMD Ryzen 7 5700G"),
    ),
)  # fmt: skip
