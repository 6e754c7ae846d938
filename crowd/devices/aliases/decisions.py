"""Decisions about models: merges, splits and kinds. Each is stored with who made it, and can be undone.

A merge does not change descriptions. It only sets `canonical`, the model under which another one is shown,
which is always computed from the accepted aliases. So undoing a merge restores the previous state exactly.
"""

from collections.abc import Iterable, Sequence

from django.db import transaction
from django.db.models import Q
from django.utils import timezone

from crowd.devices import recognition
from crowd.devices.aliases import candidates
from crowd.devices.aliases.proposals import propose
from crowd.devices.models import DeviceAlias, DeviceDescription, DeviceModel, DeviceSplit
from crowd.devices.naming.identity import Identity, identify, nameless_slug, slug_of

State = DeviceAlias.State
BY_HAND = "said by an administrator"
# Models that one search for aliases examines; it runs with every sweep.
MOST_EXAMINED = 200


class DecisionError(ValueError):
    """A decision is not possible; the message gives the reason and the remedy."""


@transaction.atomic
def propose_aliases(limit: int = MOST_EXAMINED) -> int:
    """Look for aliases of at most `limit` unexamined models. Returns the number of new proposals.

    Only these models and those that share a token with them are read, however many models a maker has.
    """
    waiting = DeviceModel.objects.filter(examined=False).order_by("pk")[:limit]
    unexamined = set(waiting.values_list("pk", flat=True))
    if not unexamined:
        return 0
    new = candidates.candidates(candidates.proposable().filter(pk__in=unexamined))
    likely = propose(candidates.candidates(candidates.partners(new)))
    pairs = DeviceAlias.objects.exclude(state=State.UNDONE).filter(
        Q(alias__in=unexamined) | Q(model__in=unexamined)
    )
    proposed = {frozenset(pair) for pair in pairs.values_list("alias", "model")}
    proposals = [
        DeviceAlias(alias_id=one.alias, model_id=one.model, reason=one.reason)
        for one in likely
        if unexamined & {one.alias, one.model} and frozenset({one.alias, one.model}) not in proposed
    ]
    DeviceAlias.objects.bulk_create(proposals)
    DeviceModel.objects.filter(pk__in=unexamined).update(examined=True)
    return len(proposals)


def propose_all_aliases() -> int:
    """Look for aliases of every model, also of examined ones. Returns the number of new proposals."""
    DeviceModel.objects.update(examined=False)
    count = 0
    while DeviceModel.objects.filter(examined=False).exists():
        count += propose_aliases()
    return count


@transaction.atomic
def decide(alias: DeviceAlias, by: str, state: DeviceAlias.State) -> None:
    """Accept a proposal, and show the alias under its model from now on; or refuse it for good.

    Raises DecisionError.
    """
    row = DeviceAlias.objects.select_for_update().select_related("alias", "model").get(pk=alias.pk)
    if row.state != State.PROPOSED:
        raise DecisionError(f"{row} is {row.state}: only a proposal can be {state}")
    if state == State.ACCEPTED:
        _check_merge(row.alias, row.model)
    row.state, row.decided_at, row.decided_by = state, timezone.now(), by
    row.save()
    if state == State.ACCEPTED:
        _update_canonical({row.alias_id, row.model_id})


@transaction.atomic
def merge(models: Sequence[DeviceModel], into: DeviceModel, by: str) -> list[DeviceAlias]:
    """Show each of `models` under `into`. Raises DecisionError, and then changes nothing."""
    done = []
    for model in models:
        if model.pk == into.pk:
            continue
        _check_merge(model, into)
        DeviceAlias.objects.filter(alias=model, model=into, state=State.PROPOSED).delete()
        done.append(
            DeviceAlias.objects.create(
                alias=model,
                model=into,
                reason=BY_HAND,
                state=State.ACCEPTED,
                decided_at=timezone.now(),
                decided_by=by,
            )
        )
    _update_canonical({into.pk, *(alias.alias_id for alias in done)})
    return done


@transaction.atomic
def undo(alias: DeviceAlias, by: str) -> None:
    """Undo a decision about an alias. Raises DecisionError."""
    row = DeviceAlias.objects.select_for_update().get(pk=alias.pk)
    if row.state not in (State.ACCEPTED, State.REFUSED):
        raise DecisionError(f"{row} is {row.state}: there is no decision to undo")
    row.state, row.undone_at, row.undone_by = State.UNDONE, timezone.now(), by
    row.save()
    _update_canonical({row.alias_id, row.model_id})


@transaction.atomic
def split(descriptions: Sequence[DeviceDescription], by: str) -> DeviceSplit:
    """Move `descriptions` from the model that the rules chose into a new one.

    Raises DecisionError if they belong to several models, if they are all of a model, or if they are split
    already.
    """
    keys = [row.pk for row in descriptions]
    rows = list(DeviceDescription.objects.select_for_update().filter(pk__in=keys).select_related("model"))
    if len({row.model_id for row in rows}) != 1:
        raise DecisionError("choose descriptions of one model, not of several or none")
    source = rows[0].model
    if any(row.split_id is not None for row in rows):
        raise DecisionError(f"{source} was split off already: undo that first")
    if not source.descriptions.exclude(pk__in=keys).exists():
        raise DecisionError(f"these are all descriptions of {source}: leave at least one")
    model = _split_off(source, identify(rows[0].raw))
    decision = DeviceSplit.objects.create(source=source, model=model, decided_by=by)
    DeviceDescription.objects.filter(pk__in=keys).update(model=model, split=decision)
    recognition.mark_changed({source.pk, model.pk})
    return decision


def _split_off(source: DeviceModel, identity: Identity) -> DeviceModel:
    """A new model like `source`, named after its chip if that differs, otherwise numbered."""
    number = source.splits.count() + 2
    differs = identity.soc if identity.soc and identity.soc != source.soc else f"variant {number}"
    key = f"{source.key[:150]}|split {number}"
    return DeviceModel.objects.create(
        key=key,
        slug=slug_of(source.manufacturer, source.name, key)
        if identity.named
        else nameless_slug(source.os, key),
        manufacturer=source.manufacturer,
        name=f"{source.name[:100]}, {differs[:45]}",
        market_name=source.market_name,
        cpu=identity.cpu or source.cpu,
        soc=identity.soc or source.soc,
        gpu=identity.gpu or source.gpu,
        os=identity.os or source.os,
        kind=source.kind,
        named=source.named,
        rare=True,
        examined=True,
    )


@transaction.atomic
def undo_split(decision: DeviceSplit, by: str) -> None:
    """Move the descriptions back to the model that the rules chose.

    Raises DecisionError if already undone.
    """
    row = DeviceSplit.objects.select_for_update().get(pk=decision.pk)
    if row.undone_at is not None:
        raise DecisionError(f"{row} was undone by {row.undone_by} already")
    row.undone_at, row.undone_by = timezone.now(), by
    row.save()
    row.descriptions.update(model=row.source, split=None)
    recognition.mark_changed({row.source_id, row.model_id})


@transaction.atomic
def set_kind(models: Iterable[DeviceModel], kind: str, by: str) -> None:
    """Set the kind of `models` by hand. The rules do not change it any more; figures are computed again.

    A model that is set to DEVICE also gets a known name.
    """
    keys = {model.pk for model in models}
    chosen = DeviceModel.objects.filter(pk__in=keys)
    named = {"named": True} if kind == DeviceModel.Kind.DEVICE else {}
    chosen.update(kind=kind, judged_by=by, judged_at=timezone.now(), **named)
    recognition.mark_changed(keys)


@transaction.atomic
def reset_kind(models: Iterable[DeviceModel]) -> None:
    """Undo `set_kind`: the rules decide the kind of `models` again."""
    keys = {model.pk for model in models}
    DeviceModel.objects.filter(pk__in=keys).update(judged_by="", judged_at=None)
    recognition.renormalise(DeviceDescription.objects.filter(model_id__in=keys))


def _check_merge(alias: DeviceModel, model: DeviceModel) -> None:
    if not alias.manufacturer or alias.manufacturer.casefold() != model.manufacturer.casefold():
        makers = f"{alias.manufacturer or 'unknown'} and {model.manufacturer or 'unknown'}"
        raise DecisionError(f"{alias} and {model} have the makers {makers}: models never merge across makers")
    if alias.canonical_id is not None:
        raise DecisionError(f"{alias} is shown as {alias.canonical} already: undo that first")
    if _root(model.pk, _edges()) == alias.pk:
        raise DecisionError(f"{model} is shown as {alias}: undo that first")


def _edges() -> dict[int, int]:
    return dict(DeviceAlias.objects.filter(state=State.ACCEPTED).values_list("alias_id", "model_id"))


def _root(key: int, edges: dict[int, int]) -> int:
    while key in edges:
        key = edges[key]
    return key


def _update_canonical(keys: set[int]) -> None:
    """Compute `canonical` again for `keys` and for all models joined with them by accepted aliases."""
    edges = _edges()
    roots = {_root(key, edges) for key in keys}
    joined = keys | roots | {alias for alias in edges if _root(alias, edges) in roots}
    for model in DeviceModel.objects.select_for_update().filter(pk__in=joined).order_by("pk"):
        root = _root(model.pk, edges)
        canonical = None if root == model.pk else root
        if model.canonical_id != canonical:
            model.canonical_id = canonical
            model.save(update_fields=["canonical"])
    recognition.mark_changed(joined)
