"""Clean-up of names that firmware reports: makers, spellings."""

import re

COMPANY = re.compile(
    r"[,.]?\s+(inc|incorporated|corp|corporation|co|company|ltd|limited|llc|gmbh|ag|s\.?a|b\.?v|plc)\b\.?,?",
    re.IGNORECASE,
)
# Makers by their well-known names: only these are shown in public.
KNOWN = (
    "360", "Acer", "Advan", "AGM", "Aiwa", "Alcatel", "Alldocube", "Alienware", "Allview", "Amazon", "Apple",
    "Archos",
    "ASRock", "Azpen", "Azumi", "BenQ", "Blackview", "Blaupunkt", "BLU", "bmobile", "BQ", "Casper", "Cat",
    "Cherry Mobile", "Compaq", "Condor", "Coolpad", "Cubot", "DEXP", "Digma", "Doogee", "Elephone",
    "Evercoss",
    "Fairphone", "Framework", "Fujitsu", "General Mobile", "Gigabyte", "Gigaset", "Gionee", "Haier",
    "Hardkernel", "Highscreen", "Hisense", "HMD Global", "Honeywell", "Honor", "Hotwav", "Hyundai", "IBM",
    "iHunt", "Infinix", "InFocus", "Inoi", "Intel", "Intex", "iQOO", "itel", "JVC", "Kyocera", "Lanix",
    "Lava", "Leagoo", "Lephone", "Letv", "LeMobile", "Logicom", "Masstel", "Maxwest", "Medion", "Meizu",
    "Micromax", "Mobicel", "Mobiwire", "Multilaser", "NEC", "Neffos", "NextBit", "Nothing", "Nubia", "NUU",
    "Onn", "Orange", "Oscal", "Oukitel", "Panasonic", "Pantech", "Philips", "POCO", "Polaroid", "Positivo",
    "Prestigio", "QMobile", "Razer", "RCA", "Realtek", "Redmi", "Reeder", "Sharp", "Sky", "Sony Ericsson",
    "SPC", "Stylo", "Supermicro", "Symphony", "System76", "Teclast", "Tecno", "Tesla", "Thomson", "Toshiba",
    "TP-Link", "Ulefone", "Umidigi", "Valve", "Verizon", "Vertex", "Vestel", "Vodafone", "Vortex", "Walton",
    "Wiko", "Wileyfox", "Wortmann", "Xen", "Yezz", "Zebra", "ZUK",
)  # fmt: skip
# Makers write their own name in several ways.
MAKERS = {name.casefold(): name for name in KNOWN} | {
    "amazon ec2": "Amazon EC2", "asus": "ASUS", "asustek": "ASUS", "asustek computer": "ASUS", "dell": "Dell",
    "google": "Google", "hewlett-packard": "HP", "hewlett packard": "HP", "hp": "HP", "htc": "HTC",
    "huawei": "Huawei", "innotek": "VirtualBox", "lenovo": "Lenovo", "lg": "LG", "lge": "LG",
    "lg electronics": "LG", "micro-star international": "MSI", "microsoft": "Microsoft",
    "motorola": "Motorola", "msi": "MSI", "nokia": "Nokia", "nvidia": "NVIDIA", "oneplus": "OnePlus",
    "oppo": "OPPO", "qemu": "QEMU", "realme": "realme", "samsung": "Samsung",
    "samsung electronics": "Samsung", "sony": "Sony", "tcl": "TCL", "vivo": "vivo", "vmware": "VMware",
    "xiaomi": "Xiaomi", "zte": "ZTE",
}  # fmt: skip
LISTED = frozenset(MAKERS.values())
# Chip makers, and placeholders of their development kits in the maker's field.
REFERENCE_MAKERS = frozenset(
    {"allwinner", "alps", "android", "aosp", "mediatek", "mtk", "qualcomm", "rockchip", "softwinner", "sprd"}
)
NAMES_NOTHING = re.compile(
    r"^(generic\b.*|generic_.*|.* for arm(64)?|full[ _](android|aosp|base).*|aosp.*|mt6\d{3}|rk3\d{3}\w*|"
    r"sprd.*)$",
    re.IGNORECASE,
)


def manufacturer(name: str) -> str:
    """The well-known name of the maker `name`, without its legal form. An unknown name stays as it is."""
    short = COMPANY.sub("", name).strip(" ,.")
    well_known = MAKERS.get(short.casefold())
    if well_known:
        return well_known
    return short.capitalize() if short.islower() or (short.isupper() and len(short) > 4) else short


def is_known_maker(name: str) -> bool:
    """Whether `name`, as `manufacturer` returns it, is a listed maker."""
    return name in LISTED


def without_maker(model: str, maker: str) -> str:
    """`model` without a leading `maker`: 'HUAWEI NXT-L29' by Huawei is NXT-L29."""
    if maker and model.casefold().startswith(f"{maker.casefold()} "):
        return model[len(maker) :].strip()
    return model


def folded(name: str) -> str:
    """`name` in lower case, only letters, digits and '+', for comparing spellings.

    'Redmi_Note-3' equals 'REDMI NOTE 3'. A Galaxy S9+ is not a Galaxy S9.
    """
    return "".join(c for c in name.casefold() if c.isalnum() or c == "+")


def names_no_model(maker: str, model: str) -> bool:
    """Whether `maker` and `model` do not name a device: no model, or the names of a development kit."""
    return not model or maker.casefold() in REFERENCE_MAKERS or bool(NAMES_NOTHING.match(model))


def display_name(manufacturer: str, name: str, market_name: str) -> str:
    """The market name followed by the code `name` in parentheses; `name` if there is no other market name."""
    market = without_maker(market_name, manufacturer)
    return f"{market} ({name})" if market and folded(market) != folded(name) else name
