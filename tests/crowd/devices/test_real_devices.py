"""The rules on strings that real devices sent, and on real catalogues."""

import csv
import os
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

from crowd.devices.aliases.proposals import Candidate, propose
from crowd.devices.catalogue import BadLine, CatalogueLine, read, store
from crowd.devices.models import CatalogueEntry
from crowd.devices.naming import chips
from crowd.devices.naming.identity import DEVICE, EMULATOR, Identity, identify
from crowd.devices.naming.names import LISTED, manufacturer

# Makers that write their own name in ways that do not begin alike.
SAME_MAKER = {"lge": "lg", "hewlett": "hp"}
DESKTOP = re.compile(
    r"inc\.|corporation|hewlett|supermicro|fujitsu|toshiba|msi|xen|innotek|vmware", re.IGNORECASE
)


@pytest.fixture(scope="module")
def devices() -> Path:
    folder = os.environ.get("FRONTRUNNER_DATA")
    if not folder:
        pytest.skip("FRONTRUNNER_DATA does not name the folder of real data")
    return Path(folder) / "devices"


@pytest.fixture(scope="module")
def volunteers(devices: Path) -> list[dict[str, str]]:
    """What volunteers' devices said of themselves: maker and model of 542 platforms."""
    with (devices / "ck_crowdtuning" / "platform.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [
        {
            "os": "Linux" if DESKTOP.search(row["vendor"]) else "Android",
            "manufacturer": row["vendor"],
            "model": row["model"],
        }
        for row in rows
    ]


@pytest.fixture(scope="module")
def chip_lines(devices: Path) -> dict[str, set[str]]:
    """Every spelling of a chip: the volunteers' processors and graphics chips, and the catalogue's."""
    tables = {
        "cpu": ("ck_crowdtuning/platform.cpu.csv", "name"),
        "gpu": ("ck_crowdtuning/platform.gpu.csv", "name"),
        "catalogued soc": ("play_catalog/android-devices-catalog.csv", "System on Chip"),
        "catalogued gpu": ("play_catalog/android-devices-catalog.csv", "GPU"),
    }
    lines = {}
    for table, (path, column) in tables.items():
        with (devices / path).open(newline="", encoding="utf-8") as file:
            lines[table] = {" ".join(row[column].split()) for row in csv.DictReader(file)} - {""}
    return lines


def test_the_rules_name_most_real_chips(chip_lines: dict[str, set[str]]) -> None:
    """What is left are lines that name no chip: "ARMv7 Processor rev 3", "unknown", boards."""
    named = {
        "cpu": [chips.processor(line) or chips.system_on_chip(line) for line in chip_lines["cpu"]],
        "gpu": [chips.graphics(line) for line in chip_lines["gpu"]],
        "catalogued soc": [chips.system_on_chip(line) for line in chip_lines["catalogued soc"]],
        "catalogued gpu": [chips.graphics(line) for line in chip_lines["catalogued gpu"]],
    }

    counts = {table: (sum(map(bool, names)), len(names)) for table, names in named.items()}

    assert counts == {
        "cpu": (131, 158),
        "gpu": (51, 69),
        "catalogued soc": (820, 843),
        "catalogued gpu": (351, 351),
    }


def test_every_real_processor_of_a_pc_is_named(chip_lines: dict[str, set[str]]) -> None:
    of_pcs = {line for line in chip_lines["cpu"] if re.search(r"intel|amd|pentium", line, re.IGNORECASE)}

    assert len(of_pcs) > 40
    assert [line for line in of_pcs if not chips.processor(line)] == []


def test_most_volunteers_devices_are_named(volunteers: list[dict[str, str]]) -> None:
    identities = [identify(raw) for raw in volunteers]

    assert sum(identity.named for identity in identities) == 387
    assert {identity.manufacturer for identity in identities if identity.named} <= LISTED


def first_word(maker: str) -> str:
    """Distinguishes makers, independently of the rules."""
    word = next(iter(re.findall(r"\w+", maker.casefold())), "")
    return SAME_MAKER.get(word, word)


def candidates(identities: dict[str, Identity]) -> Iterator[Candidate]:
    for number, identity in enumerate(identities.values()):
        yield Candidate(number, identity.manufacturer, identity.name, handheld=identity.os == "Android")


def test_volunteers_strings_come_to_so_many_models(volunteers: list[dict[str, str]]) -> None:
    """A change of the rules shows here what it does to real strings."""
    identities = {identity.key: identity for raw in volunteers for identity in [identify(raw)]}
    distinct = {(raw["manufacturer"], raw["model"]) for raw in volunteers}
    kinds: dict[str, int] = defaultdict(int)
    for identity in identities.values():
        kinds[identity.kind] += 1

    proposals = propose(candidates(identities))

    assert (len(volunteers), len(distinct), len(identities), len(proposals)) == (542, 524, 522, 2)
    assert dict(kinds) == {"device": 491, "unknown": 22, "virtual": 4, "emulator": 5}


def test_no_volunteers_device_merges_across_makers(volunteers: list[dict[str, str]]) -> None:
    makers: dict[str, set[str]] = defaultdict(set)
    identities = {}
    for raw in volunteers:
        identity = identify(raw)
        identities[identity.key] = identity
        makers[identity.key].add(first_word(raw["manufacturer"]))
    named = {key: names for key, names in makers.items() if not key.startswith("|")}
    assert {key: names for key, names in named.items() if len(names) > 1} == {}

    by_number = dict(enumerate(identities.values()))
    for proposal in propose(candidates(identities)):
        alias, model = by_number[proposal.alias], by_number[proposal.model]
        assert makers[alias.key] == makers[model.key]


@pytest.fixture(scope="module")
def catalogue(devices: Path) -> list[CatalogueLine | BadLine]:
    """The lines of Google Play's catalogue."""
    return list(read(devices / "play_catalog" / "android-devices-catalog.csv"))


@pytest.fixture(scope="module")
def catalogued(catalogue: list[CatalogueLine | BadLine]) -> list[CatalogueLine]:
    return [line for line in catalogue if isinstance(line, CatalogueLine)]


@pytest.mark.slow
def test_no_catalogued_device_merges_across_makers(catalogued: list[CatalogueLine]) -> None:
    """In Google Play's catalogue, what falls together has makers that begin with the same word."""
    makers: dict[str, set[str]] = defaultdict(set)
    for line in catalogued:
        identity = identify({"os": "Android", "manufacturer": line.maker, "model": line.device})
        makers[identity.key].add(first_word(line.maker))

    assert len(makers) > 20_000
    assert {key: names for key, names in makers.items() if len(names) > 1} == {}


@pytest.mark.slow
def test_no_catalogued_device_is_taken_for_an_emulator(catalogued: list[CatalogueLine]) -> None:
    kinds: dict[str, list[str]] = defaultdict(list)
    for line in catalogued:
        raw = {"os": "Android", "manufacturer": line.maker, "model": line.market_name, "device": line.device}
        kinds[identify(raw).kind].append(f"{line.maker} {line.market_name} {line.device}")

    # Google's own emulators are catalogued, and no other device is taken for one.
    assert {name.split()[0] for name in kinds[EMULATOR]} == {"google"}
    assert len(kinds[DEVICE]) > 24_500


@pytest.mark.slow
def test_real_catalogues_are_imported_whole_and_again(
    db: None, catalogue: list[CatalogueLine | BadLine]
) -> None:
    first = store(catalogue)
    again = store(catalogue[:5000])

    assert first.new > 24_000
    assert len(first.bad) < first.read / 100
    assert (again.new, again.changed, again.same + len(again.bad)) == (0, 0, again.read)
    galaxy = CatalogueEntry.objects.get(maker=manufacturer("samsung").casefold(), device="a16x")
    assert (galaxy.market_name, galaxy.soc) == ("Galaxy A16 5G", "Samsung Exynos 1330 (S5E8535)")


@pytest.mark.slow
def test_a_list_without_makers_is_read(devices: Path) -> None:
    lines = list(read(devices / "jaredrummler" / "devices.csv"))

    assert len(lines) > 37_000
    # 1164 codes have no name in it.
    assert {line.reason for line in lines if isinstance(line, BadLine)} == {"no market name"}
    assert sum(isinstance(line, CatalogueLine) for line in lines) > 36_000
