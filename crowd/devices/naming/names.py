"""Makers and models that may be shown in public, and the spelling of what firmware reports."""

import re
from functools import lru_cache

from crowd.devices.naming.rules import FLAGS, Rules, one_of, table

COMPANY = re.compile(
    r"[,.]?\s+(inc|incorporated|corp|corporation|co|company|ltd|limited|llc|gmbh|ag|s\.?a|b\.?v|plc)\b\.?,?",
    re.IGNORECASE,
)
_makers = table("makers")
MAKERS: dict[str, str] = {name.casefold(): name for name in _makers["makers"]} | _makers["spelled"]
# The makers that `manufacturer` returns for known names.
LISTED = frozenset(MAKERS.values())
KIT_MAKERS = frozenset(_makers["development_kits"]["makers"])
KIT = one_of(_makers["development_kits"]["models"])

LONGEST = 60
# Separators between the parts of a name.
SEPARATORS = re.compile(r"[ _/-]+|(?=\()")
# "9", "14T", "E6320", "A52s", "S22+", "(2021)", "6.1".
NUMBER = re.compile(r"\(?(?:[a-z]\d{1,4}[a-z]?|[a-z]{2}\d{1,4}|\d{1,4}(?:\.\d)?[a-z]{0,2})\+?\)?", FLAGS)
MOST_NUMBERS = 2
NEXUS = re.compile(r"nexus (?:one|s|q|4|5x?|6p?|7|9|10|player)", FLAGS)
_models = table("models")
COMMON = frozenset(_models["words"].split())
APPLE_MODELS: tuple[str, ...] = tuple(_models["apple"])
APPLE = frozenset(model.casefold() for model in APPLE_MODELS)
SERIES = {maker: frozenset(words.split()) for maker, words in _models["series"].items()}
CODES = {maker: one_of(patterns) for maker, patterns in _models["codes"].items()}
ANY_CODE = one_of(_models["codes_of_any"])
WITHOUT_MAKER = one_of(_models["without_maker"])
MAKERS_OWN = Rules({rf"\A(?:{pattern})\Z": maker for pattern, maker in _models["makers"].items()})


def manufacturer(name: str) -> str:
    """The well-known name of the maker `name`, without its legal form. An unknown name stays as it is."""
    short = COMPANY.sub("", name).strip(" ,.")
    well_known = MAKERS.get(short.casefold())
    if well_known:
        return well_known
    return short.capitalize() if short.islower() or (short.isupper() and len(short) > 4) else short


@lru_cache(maxsize=10_000)
def is_known_model(maker: str, model: str) -> bool:
    """Whether `model` has the form of a model of `maker` (from `manufacturer`; may be empty)."""
    if len(model) > LONGEST or not model.isascii():
        return False
    if not maker:
        return bool(WITHOUT_MAKER.fullmatch(model))
    if maker == "Apple" and model.casefold() in APPLE:
        return True
    if maker in CODES and CODES[maker].fullmatch(model):
        return True
    bare = re.sub(rf"^{re.escape(maker)}[ _-]", "", model, flags=FLAGS)
    return bool(ANY_CODE.fullmatch(bare) or NEXUS.fullmatch(bare)) or _is_of_a_series(maker, bare)


def _is_of_a_series(maker: str, model: str) -> bool:
    parts = [part for part in SEPARATORS.split(model) if part]
    if not parts:
        return False
    first, *rest = parts
    # "Galaxy", or with its number: "motog3", "mi5"; or a code followed by words: "Z2 Plus".
    begin = re.sub(r"\d{1,2}[a-z]?\+?$", "", first, flags=FLAGS).casefold()
    if begin not in SERIES.get(maker, ()) and not ANY_CODE.fullmatch(first):
        return False
    unlisted = [part for part in rest if part.casefold() not in COMMON]
    letters = [part for part in unlisted if len(part) == 1 and part.isalpha()]
    numbers = [part for part in unlisted if NUMBER.fullmatch(part)]
    # At most one single letter ("Moto G"): several could spell a word.
    return len(letters) <= 1 and len(numbers) <= MOST_NUMBERS and len(letters) + len(numbers) == len(unlisted)


def maker_of(model: str) -> str:
    """The only maker that uses names like `model`; empty if several do."""
    return MAKERS_OWN.name(model)


def names_no_model(maker: str, model: str) -> bool:
    """Whether `maker` and `model` do not name a device: no model, or the names of a development kit."""
    return not model or maker.casefold() in KIT_MAKERS or bool(KIT.fullmatch(model))


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


def display_name(manufacturer: str, name: str, market_name: str) -> str:
    """The market name followed by the code `name` in parentheses; `name` if there is no other market name."""
    market = without_maker(market_name, manufacturer)
    return f"{market} ({name})" if market and folded(market) != folded(name) else name
