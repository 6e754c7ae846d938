"""Chips by the name people know: systems on a chip, processors, graphics chips. Rules as data, first match
wins.

Drivers, kernels and catalogues spell one chip in many ways ("QTI SM8550", "kalama"; "Qualcomm Adreno (TM)
506", "QUALCOMM Adreno(TM) 506"). A name that no rule knows is kept as it came.
"""

import re
from dataclasses import dataclass

# Who a chip maker calls itself, in properties and in catalogues.
CHIP_MAKERS = {
    "allwinner": "Allwinner", "amlogic": "Amlogic", "apple": "Apple", "broadcom": "Broadcom",
    "google": "Google", "hisilicon": "HiSilicon", "huawei": "HiSilicon", "intel": "Intel",
    "mediatek": "MediaTek", "mtk": "MediaTek", "mstar": "MStar", "nvidia": "NVIDIA", "qcom": "Qualcomm",
    "qti": "Qualcomm", "qualcomm": "Qualcomm", "qualcomm technologies": "Qualcomm", "realtek": "Realtek",
    "rockchip": "Rockchip", "samsung": "Samsung", "spreadtrum": "Unisoc", "sprd": "Unisoc",
    "unisoc": "Unisoc",
}  # fmt: skip
# Code names of boards that stand for one chip alone. Names that several chips share (bengal, lito, holi,
# hi6250) are not here: a wrong chip is worse than none.
BOARDS = {
    "kona": "Qualcomm SM8250", "lahaina": "Qualcomm SM8350", "taro": "Qualcomm SM8450",
    "kalama": "Qualcomm SM8550", "pineapple": "Qualcomm SM8650", "sun": "Qualcomm SM8750",
    "msmnile": "Qualcomm SM8150", "trinket": "Qualcomm SM6125", "atoll": "Qualcomm SM7125",
    "yupik": "Qualcomm SM7325", "gs101": "Google Tensor", "gs201": "Google Tensor G2",
    "zuma": "Google Tensor G3", "zumapro": "Google Tensor G4", "laguna": "Google Tensor G5",
    "hi3635": "HiSilicon Kirin 935", "hi3650": "HiSilicon Kirin 950", "hi3660": "HiSilicon Kirin 960",
    "hi3670": "HiSilicon Kirin 970", "smdk4x12": "Samsung Exynos 4412", "smdk4210": "Samsung Exynos 4210",
}  # fmt: skip
MARKET_NAMES = {
    "MSM8916": "Snapdragon 410", "MSM8939": "Snapdragon 615", "MSM8953": "Snapdragon 625",
    "MSM8974": "Snapdragon 800", "MSM8994": "Snapdragon 810", "MSM8996": "Snapdragon 820",
    "MSM8998": "Snapdragon 835", "SDM630": "Snapdragon 630", "SDM636": "Snapdragon 636",
    "SDM660": "Snapdragon 660", "SDM710": "Snapdragon 710", "SDM845": "Snapdragon 845",
    "SM6125": "Snapdragon 665", "SM6225": "Snapdragon 680", "SM6375": "Snapdragon 695",
    "SM7125": "Snapdragon 720G", "SM7150": "Snapdragon 730", "SM7250": "Snapdragon 765",
    "SM7325": "Snapdragon 778G", "SM8150": "Snapdragon 855", "SM8250": "Snapdragon 865",
    "SM8350": "Snapdragon 888", "SM8450": "Snapdragon 8 Gen 1", "SM8475": "Snapdragon 8+ Gen 1",
    "SM8550": "Snapdragon 8 Gen 2", "SM8650": "Snapdragon 8 Gen 3", "SM8750": "Snapdragon 8 Elite",
    "S5E3830": "Exynos 850", "S5E8535": "Exynos 1330", "S5E8825": "Exynos 1280", "S5E8835": "Exynos 1380",
    "S5E8845": "Exynos 1480", "S5E9925": "Exynos 2200", "S5E9945": "Exynos 2400",
}  # fmt: skip
# A chip's code wherever it stands in a text. The first group is the code.
SOC_CODES = tuple(
    (maker, re.compile(pattern, re.IGNORECASE))
    for maker, pattern in (
        ("Unisoc", r"\b(sc(?:77|88|98)\d\d[a-z]?|ums\d{3,4}[a-z]?|sp\d{4}[a-z]?)\b"),
        ("Qualcomm", r"\b((?:msm|apq|sdm|sda|sm|qcm|qcs|sxr|sc8|sc7)\d{2,4}[a-z]{0,3})\b"),
        ("MediaTek", r"\b(mt\d{4}[a-z]{0,3}(?:/[a-z]{1,4})?)\b"),
        ("Samsung", r"\b(s5e\d{4})\b"),
        ("Rockchip", r"\b(rk\d{4}[a-z]?)\b"),
    )
)
SOC_NAMES = tuple(
    (re.compile(pattern, re.IGNORECASE), name)
    for pattern, name in (
        (r"\b(?:exynos|universal) ?(\d{3,4})\b", "Samsung Exynos {0}"),
        (r"\bkirin ?(\d{3,4}[a-z]?)\b", "HiSilicon Kirin {0}"),
        (r"\btensor( g\d)?\b", "Google Tensor{0}"),
        (r"\bsnapdragon[ (tm)]* (\d[\w+ ]*)", "Qualcomm Snapdragon {0}"),
        (r"\btegra ?(\w+)?\b", "NVIDIA Tegra {0}"),
        (r"\bbcm(\d{4})\b", "Broadcom BCM{0}"),
    )
)
CPU_NOISE = re.compile(
    r"\((r|tm|c)\)|\b(cpu|processor)\b|@.*$|\b\d+(\.\d+)?\s*[mg]hz\b|\b\d+-core\b|\bwith (radeon|amd)\b.*$",
    re.IGNORECASE,
)
# Renderers on the processor, and drivers' stand-ins: no graphics chip.
NO_GRAPHICS = re.compile(
    r"swiftshader|llvmpipe|softpipe|pixelflinger|emulator|virtualbox|vmware|svga3d|virgl|aspeed|matrox|"
    r"^(cpu|pthread|basic|default|unknown|chromium)\b|^pocl|\bcpu\b|\bxeon e\d|\bcore processor",
    re.IGNORECASE,
)
GRAPHICS_NOISE = re.compile(
    r"\((r|tm|c|rev \w+|\d+ mhz)\)|^\d+x |\[0x[0-9a-f]+\]|\bcorporation\b|\bimagination tech(nologies)?\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Graphics:
    """A graphics chip: the family whose driver it needs ("" where no rule knows it), and its name."""

    family: str
    name: str


# What stands for the chip in a cleaned text; {0} is the first group.
GRAPHICS = tuple(
    (family, re.compile(pattern, re.IGNORECASE), name)
    for family, pattern, name in (
        ("Mali", r"\bimmortalis[ -]?(g\d{3})", "Immortalis-{0}"),
        ("Mali", r"\bmali[ -]?([gt]?\d{2,4}\w*)", "Mali-{0}"),
        ("Mali", r"\bmali\b", "Mali"),
        ("Adreno", r"\badreno[ -]?(\d{3}\w*)", "Adreno {0}"),
        ("Adreno", r"\badreno\b", "Adreno"),
        ("PowerVR", r"\b(?:powervr )?(bxm|bxs|bxe|bxt|dxt)[ -]([\d-]+)", "PowerVR {0}-{1}"),
        ("PowerVR", r"\bpowervr (?:rogue )?(\w+(?: ?\d+\w*)?)", "PowerVR {0}"),
        ("Xclipse", r"\bxclipse (\d+)", "Samsung Xclipse {0}"),
        ("Apple", r"\bapple ([am]\d+(?: \w+)*)", "Apple {0}"),
        ("NVIDIA", r"\[((?:geforce|quadro|tesla|nvs|rtx)[^\]]*)\]", "NVIDIA {0}"),
        ("NVIDIA", r"\b((?:geforce|quadro|tesla|titan|rtx|gtx|tegra)\b.*)", "NVIDIA {0}"),
        ("NVIDIA", r"\bnvidia (.+)", "NVIDIA {0}"),
        ("Radeon", r"\[(radeon[^\]]*)\]", "AMD {0}"),
        ("Radeon", r"\b(radeon\b.*)", "AMD {0}"),
        ("Radeon", r"\b(gfx\d+\w*)", "AMD {0}"),
        ("Intel", r"\b((?:u?hd|iris|arc)\b.*)", "Intel {0}"),
        ("Vivante", r"\bgc ?(\d{3,4}\w*|nano\w*)", "Vivante GC{0}"),
        ("VideoCore", r"\b(?:v3d|videocore)\b ?([\w.]*)", "Broadcom VideoCore {0}"),
    )
)  # fmt: skip


def system_on_chip(*texts: str) -> str:
    """The system on a chip that the first telling one of TEXTS names: maker, market name and code.

    "QTI SM8550", "kalama" and "SM8550" all are "Qualcomm Snapdragon 8 Gen 2 (SM8550)". Where no rule knows
    any, the first that is not empty, with its maker's name as people know it.
    """
    given = [line for line in texts if line]
    for line in given:
        known = _known_soc(BOARDS.get(line.casefold(), line))
        if known:
            return known
    return _with_known_maker(given[0]) if given else ""


def _known_soc(line: str) -> str:
    for pattern, name in SOC_NAMES:
        if found := pattern.search(line):
            return name.format(*((group or "").title() for group in found.groups())).strip()
    for maker, pattern in SOC_CODES:
        if found := pattern.search(line):
            code = found[1].upper()
            # Trailing letters tell a revision (MSM8974AC), which is sold under the same name.
            market = MARKET_NAMES.get(code) or MARKET_NAMES.get(re.sub(r"[A-Z]+$", "", code))
            return f"{maker} {market} ({code})" if market else f"{maker} {code}"
    return ""


def _with_known_maker(line: str) -> str:
    first, _, rest = line.partition(" ")
    maker = CHIP_MAKERS.get(first.casefold().strip(","))
    return f"{maker} {rest}" if maker and rest else line


def processor(line: str) -> str:
    """A processor's model without trade marks, clocks and core counts."""
    return " ".join(CPU_NOISE.sub(" ", line).split())


def graphics(line: str) -> Graphics | None:
    """The graphics chip that a driver's or a catalogue's LINE names; None for one that is none."""
    clean = " ".join(GRAPHICS_NOISE.sub(" ", line).split())
    if not clean or NO_GRAPHICS.search(clean):
        return None
    for family, pattern, name in GRAPHICS:
        if found := pattern.search(clean):
            parts = [_cased(group) for group in found.groups() if group]
            return Graphics(family, name.format(*parts, "").strip())
    return Graphics("", clean)


def _cased(part: str) -> str:
    """Codes without spaces in capitals (g57, bxm), names as they are written; gfx1030 is written small."""
    if " " in part or part.casefold().startswith("gfx") or not re.search(r"\d", part):
        return part.upper() if re.fullmatch(r"b[xX][mset]|dxt", part, re.IGNORECASE) else part.strip()
    return part.upper()
