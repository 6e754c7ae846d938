"""Devices as browsers describe them, in the words of client hints and of adapter.info."""

from typing import Any

import pytest
from django.test import Client
from hypothesis import given
from hypothesis import strategies as st

from crowd.devices.disclosure import mask_letters, public_device
from crowd.devices.models import DeviceModel, Installation
from crowd.devices.naming import chips
from crowd.devices.naming.chips import FAMILIES, HARDWARE, SOFTWARE, VENDORS, Processor, vendor
from crowd.devices.naming.computing import driver, processor_of
from crowd.devices.naming.identity import identify
from crowd.devices.naming.raw_device import RawDevice
from crowd.devices.recognition import recognise
from crowd.results.privacy.own_page import own_page_path
from tests.builders.documents import browser_document, device_document, submission_document
from tests.builders.participant import Participant
from tests.dashboard.reading import read

IPHONE = browser_document("iOS", model=None, gpu_vendor="apple", gpu_architecture="metal-3", browser="Safari")
LINUX = browser_document("Linux", model=None, gpu_vendor="google", gpu_architecture="swiftshader")


@pytest.mark.parametrize(
    ("maker", "architecture", "name", "family"),
    [
        ("qualcomm", "adreno-7xx", "Adreno 7xx", "Adreno"),
        ("qualcomm", "", "Adreno", "Adreno"),
        ("qualcomm", "visit-my-site", "Adreno", "Adreno"),
        ("arm", "valhall", "Mali (Valhall)", "Mali"),
        ("arm", "bifrost", "Mali (Bifrost)", "Mali"),
        ("arm", "gen-5", "Mali (5th Gen)", "Mali"),
        ("apple", "metal-3", "Apple GPU", "Apple"),
        ("apple", "", "Apple GPU", "Apple"),
        ("img-tec", "rogue", "PowerVR (Rogue)", "PowerVR"),
        ("samsung", "rdna-3", "Samsung Xclipse (RDNA 3)", "Xclipse"),
        ("nvidia", "ampere", "NVIDIA Ampere", "NVIDIA"),
        ("intel", "gen-12lp", "Intel Graphics (Gen 12 LP)", "Intel"),
        ("intel", "xe-2lpg", "Intel Graphics (Xe2 LPG)", "Intel"),
        ("amd", "rdna-2", "AMD RDNA 2", "Radeon"),
        ("amd", "", "AMD Radeon Graphics", "Radeon"),
        ("broadcom", "videocore", "Broadcom VideoCore", "other"),
        ("NVIDIA", "Ampere", "NVIDIA Ampere", "NVIDIA"),
        ("hello", "visit my site", "unknown chip", "other"),
        ("", "", "unknown chip", "other"),
    ],
)
def test_an_adapter_is_a_family_of_chips(maker: str, architecture: str, name: str, family: str) -> None:
    raw = browser_document(gpu_vendor=maker, gpu_architecture=architecture)

    assert processor_of(RawDevice.parse(raw)) == Processor(name, "gpu")
    assert vendor(name) == family
    assert not chips.is_one_chip(name)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"gpu_vendor": "google", "gpu_architecture": "swiftshader"}, "SwiftShader"),
        ({"gpu_vendor": "mesa", "gpu_architecture": "software"}, "llvmpipe"),
        ({"gpu_vendor": "microsoft", "gpu_architecture": "warp"}, "Microsoft WARP"),
        ({"gpu_vendor": "", "gpu_description": "llvmpipe (LLVM 19.1.7, 256 bits)"}, "llvmpipe"),
        ({"gpu_vendor": "", "gpu_description": "SwiftShader Device (Subzero)"}, "SwiftShader"),
        ({"gpu_vendor": "nvidia", "gpu_architecture": "ampere", "gpu_fallback": "true"}, "unknown chip"),
    ],
)
def test_a_software_adapter_computes_on_the_processor(changes: dict[str, str], name: str) -> None:
    found = processor_of(RawDevice.parse(browser_document(**changes)))

    assert found == Processor(name, "cpu")
    assert vendor(found.name, "", found.kind) == "CPU"
    assert not chips.is_one_chip(name)


def test_a_description_that_names_the_chip_counts_for_more_than_its_family() -> None:
    raw = browser_document(gpu_vendor="nvidia", gpu_architecture="ampere")

    named = RawDevice.parse(raw | {"gpu_description": "NVIDIA GeForce RTX 3060"})
    numbered = RawDevice.parse(raw | {"gpu_device": "0x2504", "gpu_description": "NVIDIA"})
    assert processor_of(named).name == "NVIDIA GeForce RTX 3060"
    assert processor_of(numbered).name == "NVIDIA Ampere"
    assert chips.is_one_chip("NVIDIA GeForce RTX 3060")


@pytest.mark.parametrize("name", sorted(FAMILIES))
def test_each_family_is_known_by_its_name(name: str) -> None:
    assert vendor(name) in VENDORS
    assert name.startswith(("Broadcom", "HiSilicon")) or vendor(name) != "other"


@pytest.mark.parametrize(
    ("changes", "title", "slug"),
    [
        (IPHONE, "Apple iPhone", "apple-iphone"),
        (IPHONE | {"os": "iPadOS"}, "Apple iPad", "apple-ipad"),
        (IPHONE | {"model": "iPhone"}, "Apple iPhone", "apple-iphone"),
        (IPHONE | {"os": "macOS"}, "Mac, Apple GPU", "mac-apple-gpu"),
        (LINUX, "Linux PC, SwiftShader", "linux-pc-swiftshader"),
        (
            LINUX | {"os": "Windows", "gpu_vendor": "nvidia", "gpu_architecture": "ampere"},
            "Windows PC, NVIDIA Ampere",
            "windows-pc-nvidia-ampere",
        ),
        (LINUX | {"os": "Chrome OS", "gpu_vendor": "intel"}, "ChromeOS PC, Intel Graphics", None),
        (LINUX | {"os": "Android", "gpu_vendor": "qualcomm", "gpu_architecture": "adreno-6xx", "model": "K"},
         "Android device, Adreno 6xx", "android-device-adreno-6xx"),
        (LINUX | {"os": "Android", "gpu_vendor": ""}, "Unknown Android device", "unknown-android-device"),
        (LINUX | {"os": None}, "Device, SwiftShader", None),
    ],
)  # fmt: skip
def test_a_device_without_a_model_is_called_by_its_form_and_chip(
    changes: dict[str, Any], title: str, slug: str | None
) -> None:
    identity = identify(changes)

    assert f"{identity.manufacturer} {identity.name}".strip() == title
    assert slug in (None, identity.slug)


@pytest.mark.parametrize(
    ("model", "maker"),
    [
        ("Pixel 8 Pro", "Google"),
        ("SM-S918B", "Samsung"),
        ("moto g(30)", "Motorola"),
        ("RMX3771", "realme"),
        ("2201117TG", "Xiaomi"),
        ("KB2003", "OnePlus"),
        ("XQ-BC52", "Sony"),
        ("V2145", "vivo"),
        ("FP5", "Fairphone"),
    ],
)
def test_a_model_of_client_hints_finds_its_maker(model: str, maker: str) -> None:
    hinted = identify(browser_document(model=model))
    native = identify(device_document(model, manufacturer=maker))

    assert (hinted.manufacturer, hinted.named) == (maker, True)
    assert (hinted.key, hinted.slug) == (native.key, native.slug)


def test_what_an_owner_states_is_one_model_with_what_a_device_says() -> None:
    stated = identify(browser_document(model="Pixel 8", manufacturer="Google", model_source="owner"))

    assert stated.key == identify(device_document("Pixel 8")).key
    assert identify(IPHONE | {"model": "iPhone 15 Pro", "manufacturer": "Apple"}).named
    assert not identify(IPHONE | {"model": "iPhone 15 Visit My Site", "manufacturer": "Apple"}).named


@pytest.mark.parametrize(
    ("browser", "version", "shown"),
    [
        ("Google Chrome", "131.0.6778.86", "Chrome 131"),
        ("Microsoft Edge", "131", "Edge 131"),
        ("Safari", "26.1", "Safari 26"),
        ("Samsung Internet", "27.0", "Samsung Internet 27"),
        ("Firefox", "145.0a1", "Firefox 145"),
        ("Chromium", None, "Chromium"),
        ("Chrome", "visit my site", "Chrome"),
        ("Somebody's browser", "1", ""),
    ],
)
def test_the_driver_of_a_browser_is_the_browser(browser: str, version: str | None, shown: str) -> None:
    assert str(driver(RawDevice.parse(browser_document(browser=browser, browser_version=version)))) == shown


WORDS = st.sampled_from(
    [*HARDWARE, *(word for maker in SOFTWARE for word in (maker, *SOFTWARE[maker])), "adreno-7xx", "K"]
)
FIELDS = st.sampled_from(
    [
        "gpu_vendor",
        "gpu_architecture",
        "gpu_device",
        "gpu_description",
        "browser_version",
        "os",
        "gpu_fallback",
    ]
)


@given(st.dictionaries(FIELDS, st.text(max_size=100) | WORDS))
def test_no_text_of_a_browser_reaches_the_public(raw: dict[str, str]) -> None:
    marked = {"browser": "zzyzx"} | {name: f"{text} zzyzx" for name, text in raw.items()}
    device = RawDevice.parse(marked)

    identity, processor = identify(marked), processor_of(device)

    public = (
        identity.slug,
        identity.name,
        identity.gpu,
        identity.os,
        identity.cpu,
        identity.soc,
        identity.key,
    )
    assert "zzyzx" not in " ".join((*public, processor.name, str(driver(device)))).casefold()


@pytest.mark.slow
def test_a_text_in_place_of_a_model_stays_with_administrators(db: None) -> None:
    recognise(browser_document(model="Visit My Site"))

    model = DeviceModel.objects.get()
    shown = public_device(model)
    assert (shown.masked, shown.name) == (True, f"Adreno 7xx device ({mask_letters(model.mask)})")
    assert "visit" not in f"{shown.slug} {shown.name}"


@pytest.mark.slow
def test_a_chip_takes_the_place_of_its_family(db: None) -> None:
    for raw in (
        browser_document(model="Pixel 8", gpu_vendor="arm", gpu_architecture="valhall"),
        device_document(),
    ):
        recognise(raw)

    assert DeviceModel.objects.get().gpu == "Mali-G715"


def test_another_adapter_of_a_pc_is_the_same_device(participant: Participant) -> None:
    first = participant.submit(submission_document(device=LINUX))
    hardware = LINUX | {"gpu_vendor": "nvidia", "gpu_architecture": "ampere"}

    assert first.status_code == 202
    assert participant.submit(submission_document(device=hardware)).status_code == 202
    another = participant.submit(submission_document(device=LINUX | {"os": "Windows"}))
    assert (another.status_code, another.json()["code"]) == (409, "device_changed")
    assert {str(model) for model in DeviceModel.objects.all()} == {
        "Linux PC, SwiftShader",
        "Linux PC, NVIDIA Ampere",
    }


def test_what_a_browser_says_are_texts(participant: Participant) -> None:
    for member in ("gpu_vendor", "gpu_description", "browser", "model_source", "gpu_fallback"):
        answer = participant.submit(submission_document(device=browser_document(**{member: 7})))

        assert (answer.status_code, answer.json()["field"]) == (400, f"device.{member}")


@pytest.mark.slow
@pytest.mark.parametrize("source", ["owner", "browser"])
def test_an_own_page_says_that_its_owner_stated_the_model(
    client: Client, participant: Participant, source: str
) -> None:
    device = browser_document(model="Pixel 8", manufacturer="Google", model_source=source)
    participant.submit(submission_document(device=device))
    page = own_page_path(Installation.objects.get(pk=participant.installation_id))

    assert ("stated by its owner" in read(client, page)) == (source == "owner")
    assert "stated by its owner" not in read(client, "/devices/google-pixel-8/")
