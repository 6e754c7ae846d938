"""Model names and codes that may be shown in public: a grammar for each maker, as data.

A code has a fixed form with at most three letters in a row. A name begins with a listed series, followed by
listed words and short numbers. So a stranger can invent a model, but cannot publish a text.
"""

import re
from functools import lru_cache

from crowd.devices.naming import apple_models

LONGEST = 60
FLAGS = re.IGNORECASE | re.ASCII
# Separators between the parts of a name.
SEPARATORS = re.compile(r"[ _/-]+|(?=\()")
# "9", "14T", "E6320", "A52s", "S22+", "(2021)", "6.1".
NUMBER = re.compile(r"\(?(?:[a-z]\d{1,4}[a-z]?|[a-z]{2}\d{1,4}|\d{1,4}(?:\.\d)?[a-z]{0,2})\+?\)?", FLAGS)
MOST_NUMBERS = 2
WORDS = (
    "pro plus lite ultra max mini se 5g 4g 3g lte nfc prime play power neo note tab fold flip edge go duo "
    "dual sim fe xl zoom compact premium stylus fusion one vision macro ace grand core mega hd dtv ii iii iv "
    "gt turbo speed explorer standard edition desktop tower laptop notebook workstation server sff micro "
    "gaming gen inch studio carbon yoga nano detachable chromebook spin swift tablet phone view zenfone sp "
    "xa xz gs"
)
COMMON = frozenset(WORDS.split())
# The series that a maker's names begin with.
SERIES = {
    "Acer": "aspire chromebook enduro extensa iconia liquid nitro predator spin swift travelmate veriton",
    "Alienware": "alienware area aurora m x",
    "ASUS": "chromebook expertbook memo nexus padfone phone proart rog strix transformer tuf vivobook "
    "zenbook zenfone zenpad",
    "BLU": "advance bold c dash energy g grand life pure studio tank touchbook vivo",
    "Dell": "alienware chromebook g inspiron latitude optiplex poweredge precision venue vostro xps",
    "Framework": "laptop desktop",
    "Fujitsu": "arrows celsius esprimo lifebook primergy stylistic",
    "Google": "nexus pixel chromebook",
    "HMD Global": "nokia fusion skyline",
    "Honor": "honor magic play view note",
    "HP": "chromebook compaq elite elitebook elitedesk elitepad envy laptop notebook omen pavilion "
    "pro probook prodesk proliant slate spectre stream touchpad victus z zbook",
    "HTC": "butterfly desire exodus nexus one sensation u wildfire",
    "Huawei": "ascend enjoy honor mate matebook matepad mediapad nexus nova p pura y",
    "Infinix": "hot note smart zero",
    "Intel": "nuc",
    "iQOO": "iqoo neo z u",
    "itel": "a it p prime s vision",
    "Lava": "iris z",
    "Lenovo": "chromebook ideacentre ideapad k legion loq phab tab thinkbook thinkcentre thinkpad "
    "thinkstation vibe yoga zuk",
    "LG": "g gram k nexus optimus q stylo v velvet wing",
    "Meizu": "m mx note pro u",
    "Microsoft": "surface lumia",
    "Motorola": "edge moto motorola motog motoe nexus one razr thinkphone defy",
    "MSI": "alpha bravo creator crosshair cyborg delta katana leopard modern prestige pulse raider stealth "
    "summit sword titan vector",
    "Nokia": "nokia lumia",
    "Nothing": "phone cmf",
    "Nubia": "nubia red redmagic z",
    "NVIDIA": "jetson shield",
    "OnePlus": "ace nord one oneplus pad open",
    "OPPO": "a f find k oppo r reno",
    "POCO": "poco pocophone",
    "Razer": "blade phone",
    "realme": "c gt narzo note pad q realme x",
    "Redmi": "redmi note k pad turbo",
    "Samsung": "galaxy nexus chromebook",
    "Sharp": "aquos",
    "Sony": "vaio xperia",
    "Sony Ericsson": "xperia",
    "TCL": "alcatel tcl onetouch",
    "Tecno": "camon phantom pop pova spark tecno",
    "Toshiba": "dynabook portege satellite tecra",
    "vivo": "nex s v vivo x y t",
    "Wiko": "fever highway jerry lenny pulp rainbow ridge robby sunny tommy upulse view",
    "Xiaomi": "civi hm max mi mix pad poco redmi xiaomi note",
    "ZTE": "axon blade nubia zte",
    "ZUK": "zuk",
}
# Codes of any listed maker: "B1-770", "FP2", "X6823C", "A3-A20", "1503-A01".
ANY_CODE = (
    r"[a-z]{1,2}-?\d{2,4}[a-z]{0,2}|[a-z]{1,2}\d[a-z]?|[a-z]\d-[a-z]?\d{2,3}[a-z]?|"
    r"\d{3,4}[a-z]?(?:-[a-z]\d\d)?"
)
CODES = {
    "Amazon EC2": r"[a-z]{1,3}\d{1,2}[a-z]{0,3}\.(?:nano|micro|small|medium|metal|(?:\d{1,2}x|x)?large)",
    "Apple": r"(?:iphone|ipad|ipod|imac|imacpro|mac|macbook|macbookpro|macbookair|macmini|macpro|virtualmac)"
    r"\d{1,2},\d{1,2}",
    "ASUS": r"asus[ _](?:[a-z]\d{2,3}[a-z]{0,3}|ai\d{4}(?:_[a-z])?)|z[a-z]\d{3}k[a-z]",
    "Blackview": r"bv\d{4}[a-z]?(?: ?pro)?",
    "Google": r"sdk_g?phone\d{0,2}(?:_(?:x86|arm64|x86_64))?|google compute engine",
    "Hardkernel": r"odroid(?:[ -]?[chmnux]{1,2}\d[a-z+]?)?",
    "HP": r"z\d{1,3}(?: g\d{1,2})?(?: (?:tower|mini|sff))? workstation|"
    r"proliant [a-z]{2}\d{2,3}[a-z]? gen\d{1,2}(?: plus)?|"
    r"(?:pavilion|envy|laptop|omen|spectre|victus)(?: (?:gaming|laptop|notebook|x360)){0,2} "
    r"\d\d-[a-z]{2}\dxxx",
    "Honor": r"[a-z]{2,3}\d?-[a-z]{1,3}\d{1,2}[a-z]{0,2}",
    "HTC": r"(?:htc[ _])?(?:\d[a-z]{1,3}\d{1,3}|\d[a-z]\d[a-z]|[a-z]{1,2}\d{1,3}[a-z]{0,2})",
    "Huawei": r"[a-z]{2,3}\d?-[a-z]{1,3}\d{1,2}[a-z]{0,2}|[a-z]{1,2}\d{1,4}[a-z]?-[a-z]{1,2}\d{2,3}[a-z]?|"
    r"[a-z]\d-\d{3}[a-z]|ch\d{3} v\d",
    "Kyocera": r"ky[a-z]\d\d",
    "Lenovo": r"tb\d?-?[a-z]?\d{3,4}[a-z]{0,3}|yt\d?-[a-z]\d{3}[a-z]|[a-z]\d{1,5}[a-z]{0,2}\d{0,2}|"
    r"\d\d[a-z\d]{2}cto1ww|lenovo ?[a-z]\d{4}-[a-z]{2}|tab \d [a-z]\d{1,2}-\d{2}[a-z]",
    "LG": r"(?:lg|lm)-?[a-z]{1,2}\d{2,3}[a-z]{0,3}(?:\([a-z]{1,2}\))?|vs\d{3}[a-z]{0,2}(?: 4g)?|"
    r"lg[vl]\d\d[a-z]{0,2}",
    "Microsoft": r"virtual machine",
    "Motorola": r"xt\d{3,4}(?:-\d{1,2}|dl)?|mz\d{3}",
    "MSI": r"ms-\d[a-z\d]\d\d",
    "Multilaser": r"m\d{1,2}_?\d?g?",
    "Nokia": r"ta-\d{4}",
    "OnePlus": r"(?:oneplus|one) [a-z]\d{4}|(?:cph|[a-z]{2})\d{4}|p[a-z]{2}\d{3}",
    "OPPO": r"cph\d{4}",
    "Pantech": r"(?:vega_)?im-a\d{3}[a-z]",
    "Prestigio": r"p(?:mt|sp|ap)\d{4}(?:_[34]g)?",
    "QEMU": r"standard pc \((?:q35 \+ ich9|i440fx \+ piix), (?:1996|2009)\)",
    "realme": r"rm[xp]\d{4}",
    "Redmi": r"m?\d{4,8}[a-z]{1,3}\d{0,3}[a-z]{0,2}",
    "POCO": r"m?\d{4,8}[a-z]{1,3}\d{0,3}[a-z]{0,2}",
    "RCA": r"rc[t\d][a-z\d]{1,2}\d{2,4}[a-z]?\d{0,2}",
    "Samsung": r"(?:samsung-)?(?:sm|gt|sgh|sch|sph|shv|shw|ek|yp|gi)-[a-z]{1,2}\d{1,4}[a-z]{0,3}\d?(?:/ds)?|"
    r"sc-?\d\d[a-z]|sc[gvl]\d\d|\d{3}sc",
    "Sharp": r"sh-?[a-z]?\d{2,3}[a-z]?|sh[glv]\d\d|\d{3}sh",
    "Sony": r"xq-[a-z]{2}\d\d|so-\d\d[a-z]|so[glvt]\d\d|[a-z]?\d{3}so|sgp\d{3}|lt\d\d[a-z]{1,2}",
    "Supermicro": r"(?:sys|as|ssg)-\d{3,4}[a-z]{0,2}-[a-z\d]{1,3}",
    "TCL": r"\d{4}[a-z](?:_(?:eea|ru|tr))?",
    "Tecno": r"tecno[ _-][a-z]{1,2}\d{1,4}[a-z]{0,2}",
    "Valve": r"jupiter|galileo",
    "VirtualBox": r"virtualbox",
    "vivo": r"vivo \d{4}|v\d{4}[a-z]{0,2}|i\d{4}",
    "VMware": r"vmware virtual platform|vmware\d{1,2},\d|virtual platform",
    "Wiko": r"w[-_][ckpv]\d{3}[a-z]{0,2}",
    "Xen": r"hvm domu",
    "Xiaomi": r"m?\d{4,8}[a-z]{1,3}\d{0,3}[a-z]{0,2}|20\d{5}|wt\d{5}|mi\d[a-z]?",
    "ZTE": r"nx\d{3}[a-z]|(?:zte )?[a-z]\d{3,4}[a-z]{0,2}|\d{3}zt",
}
# Computers whose model contains the maker, with an empty maker field.
WITHOUT_MAKER = re.compile(
    r"raspberry pi (?:\d(?: model [ab])?|zero(?: 2)?(?: w)?|400|500|compute module \d)"
    r"(?: plus|\+)?(?: rev \d\.\d)?|"
    r"nvidia jetson (?:nano|tx[12]|xavier nx|agx xavier|agx orin|orin nano|orin nx)(?: developer kit)?|"
    r"hardkernel odroid[ -][a-z]{1,2}\d[a-z]?",
    FLAGS,
)
# Codes and names that only one maker uses: browsers report the model without its maker.
MAKERS_OWN = tuple(
    (re.compile(pattern, FLAGS), maker)
    for pattern, maker in (
        (r"(?:sm|gt|sgh|sch|sph|shv|shw)-[a-z]{1,2}\d.*|galaxy\b.*", "Samsung"),
        (r"pixel(?: .*)?", "Google"),
        (r"moto(?:rola)?\b.*|xt\d{4}.*", "Motorola"),
        (r"rmx\d{4}", "realme"),
        (r"oneplus\b.*|(?:gm|hd|in|kb|le|ne)2?\d{3}", "OnePlus"),
        (r"m?2\d{3,7}[a-z]{1,3}\d{0,3}[a-z]{0,2}|(?:mi|redmi|poco|xiaomi)\b.*", "Xiaomi"),
        (r"xq-[a-z]{2}\d\d|so-\d\d[a-z]|xperia\b.*", "Sony"),
        (r"vivo\b.*|v\d{4}[a-z]{0,2}", "vivo"),
        (r"fp\d", "Fairphone"),
        (r"asus[_ ].*", "ASUS"),
        (r"lenovo\b.*|tb-?[a-z]?\d{3,4}.*", "Lenovo"),
        (r"(?:iphone|ipad)\b.*", "Apple"),
    )
)
APPLE = frozenset(model.casefold() for model in apple_models.MODELS)
NEXUS = re.compile(r"nexus (?:one|s|q|4|5x?|6p?|7|9|10|player)", FLAGS)
COMPILED = {maker: re.compile(code, FLAGS) for maker, code in CODES.items()}
ANY = re.compile(ANY_CODE, FLAGS)


@lru_cache(maxsize=10_000)
def is_known_model(maker: str, model: str) -> bool:
    """Whether `model` has the form of a model of `maker` (from `names.manufacturer`; may be empty)."""
    if len(model) > LONGEST or not model.isascii():
        return False
    if not maker:
        return bool(WITHOUT_MAKER.fullmatch(model))
    if maker == "Apple" and model.casefold() in APPLE:
        return True
    if maker in COMPILED and COMPILED[maker].fullmatch(model):
        return True
    bare = re.sub(rf"^{re.escape(maker)}[ _-]", "", model, flags=FLAGS)
    return bool(ANY.fullmatch(bare) or NEXUS.fullmatch(bare)) or _is_of_a_series(maker, bare)


def maker_of(model: str) -> str:
    """The only maker that uses names like `model`; empty if several do."""
    return next((maker for pattern, maker in MAKERS_OWN if pattern.fullmatch(model)), "")


def _is_of_a_series(maker: str, model: str) -> bool:
    parts = [part for part in SEPARATORS.split(model) if part]
    if not parts:
        return False
    first, *rest = parts
    series = frozenset(SERIES.get(maker, "").split())
    # "Galaxy", or with its number: "motog3", "mi5"; or a code followed by words: "Z2 Plus".
    begin = re.sub(r"\d{1,2}[a-z]?\+?$", "", first, flags=FLAGS).casefold()
    if begin not in series and not ANY.fullmatch(first):
        return False
    unlisted = [part for part in rest if part.casefold() not in COMMON]
    letters = [part for part in unlisted if len(part) == 1 and part.isalpha()]
    numbers = [part for part in unlisted if NUMBER.fullmatch(part)]
    # At most one single letter ("Moto G"): several could spell a word.
    return len(letters) <= 1 and len(numbers) <= MOST_NUMBERS and len(letters) + len(numbers) == len(unlisted)
