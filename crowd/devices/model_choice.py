"""Models that an owner can choose: Apple's, those of the imported catalogue, and names that rules accept."""

from collections.abc import Iterator

import msgspec
from django.db.models import Q

from crowd.devices.models import CatalogueEntry
from crowd.devices.naming import names

MOST_CHOICES = 50
MOST_WORDS = 6


class ModelChoice(msgspec.Struct):
    """A model to choose: `manufacturer` and `model` are sent, `name` is shown."""

    manufacturer: str
    model: str
    name: str


def find(maker: str, search: str) -> list[ModelChoice]:
    """At most MOST_CHOICES models of `maker` whose names contain all words of `search`. One query.

    An empty `maker` means any maker. If no model is listed, `search` itself is offered if it is a valid model
    name of a known maker.
    """
    maker = names.manufacturer(" ".join(maker.split()))
    words = search.casefold().split()[:MOST_WORDS]
    if not maker and not words:
        return []
    choices: dict[tuple[str, str], ModelChoice] = {}
    listed = [*_apple_models(maker, words), *_catalogue_models(maker, words)]
    for choice in listed or _typed_model(maker, search):
        choices.setdefault((choice.manufacturer.casefold(), names.folded(choice.model)), choice)
    return sorted(choices.values(), key=lambda choice: (choice.manufacturer, choice.name))[:MOST_CHOICES]


def _apple_models(maker: str, words: list[str]) -> Iterator[ModelChoice]:
    if maker not in ("", "Apple"):
        return
    for model in names.APPLE_MODELS:
        if all(word in f"apple {model}".casefold() for word in words):
            yield ModelChoice("Apple", model, model)


def _catalogue_models(maker: str, words: list[str]) -> Iterator[ModelChoice]:
    rows = CatalogueEntry.objects.exclude(maker="").exclude(code="")
    if maker:
        rows = rows.filter(maker=maker.casefold())
    for word in words:
        rows = rows.filter(Q(market_name__icontains=word) | Q(code__contains=word) | Q(maker__contains=word))
    columns = rows.order_by("maker", "market_name", "code").values_list("maker", "code", "market_name")
    for name, code, market_name in columns[: 2 * MOST_CHOICES]:
        manufacturer = names.manufacturer(name)
        model = names.without_maker(market_name, manufacturer)
        if names.folded(model) != names.folded(code):
            model = _spelled(code)
        yield ModelChoice(manufacturer, model, names.display_name(manufacturer, model, market_name))


def _typed_model(maker: str, search: str) -> Iterator[ModelChoice]:
    """`search` as a model of `maker`, or of the maker that its text reveals."""
    text = " ".join(search.split())
    named = [each for each in names.LISTED if text.casefold().startswith(f"{each.casefold()} ")]
    brand = maker or max(named, key=len, default="")
    model = names.without_maker(text, brand)
    brand = brand or names.maker_of(model)
    if brand in names.LISTED and names.is_known_model(brand, model):
        yield ModelChoice(brand, _spelled(model), _spelled(model))


def _spelled(model: str) -> str:
    """`model` with capital letters, if it was typed in lower case."""
    if model != model.casefold():
        return model
    return model.title() if " " in model else model.upper()
