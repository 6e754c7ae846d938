"""Models that an owner may choose from where a browser does not name the device's."""

from dataclasses import dataclass

from django.db.models import Q

from crowd.devices.models import CatalogueEntry

MOST = 50
APPLE = "Apple"
# What runs iOS or iPadOS 26, the first with WebGPU (support.apple.com, November 2026).
IPHONES = (
    "iPhone 11", "iPhone 11 Pro", "iPhone 11 Pro Max", "iPhone SE (2020)", "iPhone 12 mini", "iPhone 12",
    "iPhone 12 Pro", "iPhone 12 Pro Max", "iPhone 13 mini", "iPhone 13", "iPhone 13 Pro", "iPhone 13 Pro Max",
    "iPhone SE (2022)", "iPhone 14", "iPhone 14 Plus", "iPhone 14 Pro", "iPhone 14 Pro Max", "iPhone 15",
    "iPhone 15 Plus", "iPhone 15 Pro", "iPhone 15 Pro Max", "iPhone 16e", "iPhone 16", "iPhone 16 Plus",
    "iPhone 16 Pro", "iPhone 16 Pro Max", "iPhone 17", "iPhone Air", "iPhone 17 Pro", "iPhone 17 Pro Max",
    "iPad (2020)", "iPad (2021)", "iPad (2022)", "iPad (2025)", "iPad mini (2019)", "iPad mini (2021)",
    "iPad mini (2024)", "iPad Air (2019)", "iPad Air (2020)", "iPad Air (2022)", "iPad Air (2024)",
    "iPad Air (2025)", "iPad Pro (2018)", "iPad Pro (2020)", "iPad Pro (2021)", "iPad Pro (2022)",
    "iPad Pro (2024)", "iPad Pro (2025)",
)  # fmt: skip


@dataclass(frozen=True)
class Model:
    """A model by its maker, as clients send it, and as people call it."""

    manufacturer: str
    model: str
    name: str


def matching(search: str) -> list[Model]:
    """At most MOST models whose name holds every word of SEARCH. One query, none for an empty SEARCH."""
    words = search.casefold().split()
    if not words:
        return []
    apple = [
        Model(APPLE, name, f"{APPLE} {name}")
        for name in IPHONES
        if all(word in f"{APPLE} {name}".casefold() for word in words)
    ]
    wanted = Q()
    for word in words:
        wanted &= Q(market_name__icontains=word) | Q(code__icontains=word) | Q(maker__icontains=word)
    entries = (
        CatalogueEntry.objects.filter(wanted).exclude(maker="").exclude(code="")[: MOST - len(apple[:MOST])]
    )
    listed = [Model(row.maker, row.code, f"{row.market_name} ({row.code})") for row in entries]
    return [*apple[:MOST], *listed]
