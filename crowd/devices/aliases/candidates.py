"""Stored models that may be aliases of new models. Only models that share a token are read."""

from collections import defaultdict
from collections.abc import Iterable, Sequence

from django.db.models import CharField, F, Q, QuerySet, Value
from django.db.models.expressions import Combinable
from django.db.models.fields.json import KT
from django.db.models.functions import Cast, Lower, Replace

from crowd.devices.aliases.proposals import DEVICE_NAME, MARKET_NAME, REGION, SPELLING, Candidate, tokens
from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.devices.naming.names import folded
from crowd.records.device import HANDHELD

# Most partners and device names that one search reads, however many clients have sent.
MOST_PARTNERS = 1_000
MOST_DEVICES = 10_000
# Separators that the database removes from names; `names.folded` removes all punctuation.
PUNCTUATION = (" ", "-", "_", ".", ",", "/", "(", ")")


def candidates(models: Iterable[DeviceModel]) -> list[Candidate]:
    """`models` as candidates that the rules can compare. One query."""
    chosen = list(models)
    devices: dict[int, set[str]] = defaultdict(set)
    rows = (
        DeviceDescription.objects.filter(model__in=chosen)
        .order_by()
        .values_list("model_id", KT("raw__device"))
        .distinct()[:MOST_DEVICES]
    )
    for key, device in rows:
        devices[key].add(device or "")
    return [
        Candidate(
            key=model.pk,
            manufacturer=model.manufacturer,
            name=model.name,
            market_name=model.market_name,
            soc=model.soc,
            cpu=model.cpu,
            handheld=model.os in HANDHELD,
            devices=frozenset(devices[model.pk] - {""}),
        )
        for model in chosen
    ]


def partners(new: Sequence[Candidate]) -> QuerySet[DeviceModel]:
    """Models that share a maker and a token with one of `new`, including `new` itself.

    At most MOST_PARTNERS, oldest first.
    """
    shared: dict[str, set[str]] = defaultdict(set)
    for one in new:
        for reason, token in tokens(one):
            shared[reason].add(token)
    names = shared[SPELLING] | shared[MARKET_NAME] | shared[DEVICE_NAME]
    makers = {one.manufacturer for one in new} - {""}
    # A name may also begin with the name of its maker.
    spelled = names | {folded(maker) + name for maker in makers for name in shared[SPELLING]}
    wanted = Q(folded_name__in=spelled) | Q(folded_market_name__in=names)
    wanted |= Q(pk__in=_with_devices(makers, shared[DEVICE_NAME]))
    socs = {one.soc for one in new if one.handheld} - {""}
    for stem in sorted(shared[REGION]):
        wanted |= Q(name__istartswith=stem, soc__in=socs)
    models = (
        proposable()
        .filter(manufacturer__in=makers)
        .annotate(folded_name=_folded(F("name")), folded_market_name=_folded(F("market_name")))
    )
    return models.filter(wanted).order_by("pk")[:MOST_PARTNERS]


def proposable() -> QuerySet[DeviceModel]:
    """The models that may get aliases: devices that are not aliases themselves."""
    return DeviceModel.objects.filter(
        canonical=None, kind__in=[DeviceModel.Kind.DEVICE, DeviceModel.Kind.UNKNOWN]
    )


def _with_devices(makers: set[str], devices: set[str]) -> QuerySet[DeviceDescription, int]:
    """The primary keys of models of `makers` with a description that names one of `devices`."""
    rows = DeviceDescription.objects.filter(model__manufacturer__in=makers)
    rows = rows.annotate(folded_device=_folded(Cast(KT("raw__device"), CharField())))
    return rows.filter(folded_device__in=devices).order_by().values_list("model_id", flat=True)


def _folded(text: Combinable) -> Combinable:
    for mark in PUNCTUATION:
        text = Replace(text, Value(mark))
    return Lower(text)
