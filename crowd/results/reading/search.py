"""Search of devices by name, maker, model code, former name or chip; also of known, unmeasured devices.

It only uses public data: a masked model is found by its chip, never by its name.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from django.conf import settings
from django.db.models import Count, Q

from crowd.devices import revision
from crowd.devices.disclosure import is_disclosed
from crowd.devices.models import CatalogueEntry, DeviceModel
from crowd.devices.naming import names
from crowd.devices.naming.chips import VENDORS
from crowd.devices.naming.spelling import LEAST_INSIDE, Vocabulary, words
from crowd.records.measured_device import DeviceRow
from crowd.results.reading.devices import devices
from crowd.results.reading.versioned_cache import VersionedCache

MAX_WORDS = 8
MAX_ENTRIES = 300  # of the catalogue that are read
CODE = re.compile(r"(.+) \((.+)\)")
# The score of a typed word: equal to a word of a name, its beginning, or inside it.
EXACT, BEGINS, INSIDE = 4, 3, 1


@dataclass(frozen=True)
class UnmeasuredDevice:
    """A device of the catalogue without a measurement: its maker, market name and model codes."""

    maker: str
    name: str
    codes: tuple[str, ...]

    @property
    def title(self) -> str:
        return f"{self.maker} {self.name}".strip()


@dataclass(frozen=True)
class SearchResult:
    """The devices found for `text`, best match first. `corrected`: the corrected text, "" if unchanged."""

    text: str
    corrected: str
    devices: tuple[DeviceRow, ...]
    unmeasured: tuple[UnmeasuredDevice, ...]


@dataclass(frozen=True, eq=False)
class _Entry:
    """A measured device: the words that find it, and the folded names that the catalogue may use."""

    row: DeviceRow
    words: tuple[str, ...]
    folded: str
    catalogue_names: frozenset[str]


@dataclass(frozen=True)
class _Index:
    entries: tuple[_Entry, ...]
    vocabulary: Vocabulary


_indexes: VersionedCache[_Index] = VersionedCache(2)


def search(text: str) -> SearchResult:
    """Devices with every word of `text` in a name or chip.

    An unknown word is corrected if it differs from a known one by one letter. At most twenty-two queries;
    four if nothing changed since the last search of this process.
    """
    typed = words(text)[:MAX_WORDS]
    if not typed:
        return SearchResult(text, "", (), ())
    index = _indexes.get(revision.current, None, _index)
    wanted = [index.vocabulary.correct(word) for word in typed]
    scores = {entry: score for entry in index.entries if (score := _score(wanted, entry))}
    unmeasured = []
    for group in _catalogue(wanted):
        measured = [entry for entry in index.entries if entry.catalogue_names & _catalogue_names(group)]
        for entry in measured:
            scores.setdefault(entry, INSIDE)
        if not measured:
            unmeasured.append(group)
    ranked = sorted(
        scores, key=lambda entry: (-scores[entry], len(entry.row.device.title), entry.row.device.slug)
    )
    return SearchResult(
        text=text,
        corrected=" ".join(wanted) if wanted != typed else "",
        devices=tuple(entry.row for entry in ranked),
        unmeasured=tuple(unmeasured),
    )


def _index() -> _Index:
    former = _former_names()
    entries = [_entry(row, former.get(row.device.slug, ())) for row in devices()]
    texts = [" ".join(entry.words) for entry in entries]
    lines = CatalogueEntry.objects.values_list("maker", "market_name", "soc", "gpu")
    texts += [" ".join(line) for line in lines.iterator(chunk_size=10_000)]
    return _Index(tuple(entries), Vocabulary(texts))


def _entry(row: DeviceRow, former: Iterable[str]) -> _Entry:
    device = row.device
    parts = (device.title, *former, device.soc, device.gpu, device.cpu, device.os, VENDORS[device.vendor])
    coded = CODE.fullmatch(device.name)
    titles = coded.groups() if coded else (device.name,)
    return _Entry(
        row=row,
        words=tuple(dict.fromkeys(words(" ".join(parts)))),
        folded=names.folded(" ".join((device.title, *former))),
        catalogue_names=frozenset(
            names.folded(f"{device.manufacturer}{name}") for name in titles if not device.masked
        ),
    )


def _former_names() -> dict[str, list[str]]:
    """The names of aliases by the slug of their model.

    An alias of few installations is left out: it could identify a participant.
    """
    aliases = (
        DeviceModel.objects.filter(canonical__isnull=False, named=True)
        .select_related("canonical")
        .annotate(installations=Count("descriptions__sessions__installation", distinct=True))
    )
    former: dict[str, list[str]] = defaultdict(list)
    for alias in aliases:
        common = alias.installations == 0 or alias.installations >= settings.FRONTRUNNER_RARE_BELOW
        if common and is_disclosed(alias.canonical_or_self):
            former[alias.canonical_or_self.slug].append(str(alias))
    return former


def _score(wanted: Sequence[str], entry: _Entry) -> int:
    """The score of `entry` for the words `wanted`; 0 if it lacks one of them."""
    total = 0
    for word in wanted:
        best = max((_match(candidate, word) for candidate in entry.words), default=0)
        if not best and len(word) >= LEAST_INSIDE and word in entry.folded:
            best = INSIDE
        if not best:
            return 0
        total += best
    return total


def _match(candidate: str, word: str) -> int:
    if candidate == word:
        return EXACT
    if candidate.startswith(word):
        return BEGINS
    return INSIDE if len(word) >= LEAST_INSIDE and word in candidate else 0


def _catalogue(wanted: Sequence[str]) -> list[UnmeasuredDevice]:
    """Devices of the catalogue with all words of `wanted`, shortest names first. One query."""
    lines = CatalogueEntry.objects.all()
    for word in wanted:
        columns = ("market_name", "maker", "code", "device", "soc", "gpu")
        any_of = Q()
        for column in columns:
            any_of |= Q(**{f"{column}__icontains": word})
        lines = lines.filter(any_of)
    groups: dict[tuple[str, str], list[str]] = defaultdict(list)
    for maker, name, code, device in lines.order_by("pk").values_list(
        "maker", "market_name", "code", "device"
    )[:MAX_ENTRIES]:
        groups[maker, name].append((code or device).upper())
    matches = []
    for (maker, name), codes in groups.items():
        brand = names.manufacturer(maker)
        matches.append(UnmeasuredDevice(brand, names.without_maker(name, brand), tuple(sorted(set(codes)))))
    return sorted(matches, key=lambda group: (-_name_match(wanted, group), len(group.title), group.title))


def _name_match(wanted: Sequence[str], group: UnmeasuredDevice) -> int:
    title_words = words(group.title)
    return sum(max((_match(each, word) for each in title_words), default=0) for word in wanted)


def _catalogue_names(group: UnmeasuredDevice) -> frozenset[str]:
    return frozenset(names.folded(f"{group.maker}{name}") for name in (group.name, *group.codes))
