"""Rules for the names that properties, kernels and catalogues give to systems on a chip."""

import re

from crowd.devices.chips.central_processors import processor
from crowd.devices.chips.rules import compile_rules, first_match

# Code names of boards that mean exactly one chip. Names that several chips share (bengal, lito, holi, hi6250)
# are left out: a wrong chip is worse than an unknown one.
BOARDS = {
    "kona": "Qualcomm SM8250", "lahaina": "Qualcomm SM8350", "taro": "Qualcomm SM8450",
    "kalama": "Qualcomm SM8550", "pineapple": "Qualcomm SM8650", "sun": "Qualcomm SM8750",
    "msmnile": "Qualcomm SM8150", "trinket": "Qualcomm SM6125", "atoll": "Qualcomm SM7125",
    "yupik": "Qualcomm SM7325", "gs101": "Google Tensor", "gs201": "Google Tensor G2",
    "zuma": "Google Tensor G3", "zumapro": "Google Tensor G4", "laguna": "Google Tensor G5",
    "hi3635": "HiSilicon Kirin 935", "hi3650": "HiSilicon Kirin 950", "hi3660": "HiSilicon Kirin 960",
    "hi3670": "HiSilicon Kirin 970", "smdk4x12": "Samsung Exynos 4412", "smdk4210": "Samsung Exynos 4210",
    "tegra124": "NVIDIA Tegra K1", "tegra132": "NVIDIA Tegra K1", "tegra210": "NVIDIA Tegra X1",
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
# A chip has the same name whether its code or its market name is given.
CODES = {
    f"{'Samsung' if code.startswith('S5E') else 'Qualcomm'} {market}": code
    for code, market in MARKET_NAMES.items()
}
MARKED = re.compile(r"\((?:r|tm)\)|[®™]", re.IGNORECASE)
CODE = re.compile(r"^(?:Qualcomm|Samsung) ([A-Z]+\d[\dXE]\d*)")
RULES = compile_rules(
    (
        (r"\b(sc(?:7[12]80|8[12]80))(xp?)?\b", "Qualcomm {0}{1}"),
        (
            r"\b(msm|apq|mdm|sdm|sda|qcm|qcs|qrb|qm|sxr|sm|sw|sa|sg) ?(\d[\dx]\d{1,2})"
            r"(pro|sg|dt|a[abcu]|[apqt])?\b",
            "Qualcomm {0}{1}{2}",
        ),
        (r"\b(s5e\d{4})\b", "Samsung {0}"),
        (r"\b(?:exynos|universal)(?: ?octa)? ?(w?\d{3,4}[ab]?)\b", "Samsung Exynos {0}"),
        (r"\bkirin ?(\d{3,4}[aefls]?)\b", "HiSilicon Kirin {0}"),
        (r"\bk3v2", "HiSilicon K3V2"),
        (r"\bhisilicon hi(\d{4}(?:[cm]v\d{3})?)\b", "HiSilicon Hi{0}"),
        (r"\btensor(?: (g\d))?\b", "Google Tensor {0}"),
        (r"\bsnapdragon ([4678]s?\+?) ?(gen \d)\b", "Qualcomm Snapdragon {0} {1}"),
        (r"\bsnapdragon 8s? (elite)(?: (gen \d))?\b", "Qualcomm Snapdragon 8 {0} {1}"),
        (r"\bsnapdragon (\d{3}[g+]?)(?!\w)", "Qualcomm Snapdragon {0}"),
        (r"\btegra ?(k1|x1\+?|x2|[234])(?!\w)", "NVIDIA Tegra {0}"),
        (r"\btegra\b", "NVIDIA Tegra"),
        (r"\bbcm(\d{4,5}[a-z]?\d?)\b", "Broadcom BCM{0}"),
        (r"\b(sc(?:54\d|6[58]|77|88|98)\d\d[a-z]{0,2}|ums\d{3,4}[a-z]?|sp\d{4}[a-z]?)\b", "Unisoc {0}"),
        (r"\b(?:unisoc|spreadtrum|sprd|tiger) (t\d{3,4})\b", "Unisoc {0}"),
        (
            r"\bmtk? ?(\d{4})(p\d\d|[a-z]{1,2})?(_[a-z])?"
            r"(/(?:[acdhmnpt]{1,2}za|[cwx][ab][ab]|[a-z]{1,2}))?(?![a-z\d])",
            "MediaTek MT{0}{1}{2}{3}",
        ),
        (r"\bmediatek (t\d\d)p?\b", "MediaTek {0}"),
        (r"\b(rk\d{4}[a-z]?)\b", "Rockchip {0}"),
        (r"\ballwinner ([aht]\d{2,3}[a-z]?) ?(pro)?\b", "Allwinner {0} {1}"),
        (r"\bamlogic (?:aml)?([agst]\d{3}[a-z]?\d?[a-z]?)\b", "Amlogic {0}"),
        (r"\brealtek (rtd\d{4}[a-z]?)\b", "Realtek {0}"),
        (r"\bmstar (msd\d[a-z\d]\d{2,3}|t\d\d)\b", "MStar {0}"),
        (r"\b(pxa\d(?:\d{2,3}|l\d\d))\b", "Marvell {0}"),
        (r"\bmarvell (px\d{3}|bg\d)(q)?(4k|-ct)?\b", "Marvell {0}{1}{2}"),
        (r"\b(omap\d{4})\b", "TI {0}"),
        (r"\bi\.?mx ?(\d[a-z]{0,2})(?:[ -](mini|nano|plus))?\b", "NXP i.MX {0} {1}"),
        (r"\bst[ -]ericsson (u8\d00)\b", "ST-Ericsson {0}"),
        (r"\bsynaptics vs-?(\d{3})\b", "Synaptics VS{0}"),
        (r"\bxring (o\d)\b", "Xiaomi XRING {0}"),
        (r"\basr(\d{4}[a-z]?)\b", "ASR{0}"),
        (r"\bxilinx zynq\b", "Xilinx Zynq"),
        (r"\bapple (a\d{1,2}|m\d)\b(?: (bionic|fusion|pro|max|ultra)\b)?", "Apple {0} {1}"),
    )
)


def system_on_chip(*texts: str) -> str:
    """The system on a chip that `texts` name: maker, market name and code. The first known text counts.

    "QTI SM8550", "kalama" and "SM8550" all are "Qualcomm Snapdragon 8 Gen 2 (SM8550)". Empty if no rule
    matches.
    """
    return next((name for line in texts if (name := _named(line))), "")


def _named(line: str) -> str:
    clean = " ".join(MARKED.sub(" ", BOARDS.get(line.casefold(), line)).split())
    if re.match(r"(?:intel|amd)\b", clean, re.IGNORECASE):
        return processor(clean)
    name = first_match(RULES, clean)
    if name in CODES:
        return f"{name} ({CODES[name]})"
    if match := CODE.match(name):
        # Trailing letters are a revision (MSM8974AC), which is sold under the same name.
        code, maker = name.split()[1], name.split()[0]
        market = MARKET_NAMES.get(code) or MARKET_NAMES.get(match[1])
        return f"{maker} {market} ({code})" if market else name
    return name
