"""From raw strings to the model people know."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.devices.models import DeviceModel
from crowd.devices.naming.identity import identify
from crowd.devices.recognition import recognise
from tests.crowd.recognised import described

PC = {
    "os": "Debian GNU/Linux",
    "manufacturer": "Dell Inc.",
    "model": "XPS 15 9520",
    "cpu": "12th Gen Intel(R) Core(TM) i7-12700H",
    "opencl_platform": "NVIDIA CUDA",
    "opencl_device": "NVIDIA GeForce RTX 3050 Ti Laptop GPU",
}


def test_a_phone_is_its_maker_and_model() -> None:
    raw = {"os": "Android", "manufacturer": "HUAWEI", "model": "HUAWEI NXT-L29"}

    identity = identify(raw | {"board_platform": "hi3650", "egl": "mali"})

    assert (identity.manufacturer, identity.name, identity.slug) == ("Huawei", "NXT-L29", "huawei-nxt-l29")
    assert (identity.soc, identity.gpu, identity.os) == ("HiSilicon Kirin 950", "Mali", "Android")


def test_a_pc_is_its_product_and_processor() -> None:
    identity = identify(PC)

    assert (identity.name, identity.named) == ("XPS 15 9520, Intel Core i7-12700H", True)
    assert (identity.manufacturer, identity.os) == ("Dell", "Linux")
    assert identity.gpu == "NVIDIA GeForce RTX 3050 Ti Laptop GPU"


@pytest.mark.parametrize(
    "changes",
    [
        {"cpu": "12th Gen Intel(R) Core(TM) i7-12700H @ 2.30GHz"},
        {"manufacturer": "DELL INC."},
        {"manufacturer": "Dell  Inc."},
        {"os": "Windows", "os_version": "26100"},
        {"opencl_driver": "560.35", "kernel": "6.1.0-28-amd64", "memory": "34359738368"},
    ],
)
def test_clocks_drivers_and_spelling_do_not_split_a_model(changes: dict[str, str]) -> None:
    assert identify(PC | changes).key == identify(PC).key


def test_a_processor_that_computes_opencl_is_no_graphics_chip() -> None:
    pocl = {"opencl_platform": "Portable Computing Language", "opencl_device": "pthread-AMD EPYC 7B13"}

    assert identify(PC | pocl).gpu == ""


def test_what_firmware_did_not_fill_in_is_nothing() -> None:
    raw = {"manufacturer": "To Be Filled By O.E.M.", "model": "System Product Name", "cpu": "AMD Ryzen 5"}

    identity = identify(raw)

    assert (identity.manufacturer, identity.name) == ("", "AMD Ryzen 5")


def test_a_device_that_says_nothing_still_has_a_name() -> None:
    assert identify({}).name == "Unknown device"
    assert identify({"os": "Windows"}).slug == "unknown-windows-device"
    assert identify({"model": 7, "manufacturer": ["a"]}).name == "Unknown device"


FIELDS = st.sampled_from([*PC, "soc_model", "egl", "brand", "board"])


@given(st.dictionaries(FIELDS, st.text(max_size=300) | st.none()))
def test_any_strings_give_an_identity_that_fits(raw: dict[str, str | None]) -> None:
    identity = identify(raw)

    assert identity.name
    assert identity.slug.strip("-")
    for field in DeviceModel._meta.concrete_fields:
        value = getattr(identity, field.name, "")
        assert not isinstance(value, str) or len(value) <= (field.max_length or 1000)


def test_equal_strings_are_stored_once(db: None, django_assert_num_queries: Any) -> None:
    first = recognise(PC)

    with django_assert_num_queries(1):
        again = recognise(dict(reversed(PC.items())))

    assert again == first


def test_what_a_later_device_tells_completes_the_model(db: None) -> None:
    described(PC | {"opencl_device": None, "opencl_platform": None})
    assert DeviceModel.objects.get(kind="device").gpu == ""

    described(PC)

    assert DeviceModel.objects.get(kind="device").gpu.startswith("NVIDIA GeForce")


def test_two_models_never_share_an_address(db: None) -> None:
    first = described({"os": "Android", "manufacturer": "Google", "model": "Pixel-8"}).model
    second = described({"os": "Android", "manufacturer": "Google", "model": "Pixel 8"}).model

    assert first.pk != second.pk
    assert first.slug == "google-pixel-8"
    assert second.slug.startswith("google-pixel-8-")


@pytest.mark.parametrize(
    ("maker", "model"),
    [
        ("Google", "Pixel 8 Pro"),
        ("HUAWEI", "HUAWEI NXT-L29"),
        ("samsung", "SM-S918B"),
        ("SAMSUNG", "GT-I9300"),
        ("samsung", "SM-G960F/DS"),
        ("Apple", "iPhone15,2"),
        ("Apple Inc.", "Mac14,2"),
        ("Xiaomi", "2201117TY"),
        ("Xiaomi", "Redmi Note 11"),
        ("motorola", "moto g(30)"),
        ("OnePlus", "A6003"),
        ("OnePlus", "CPH2581"),
        ("Sony", "XQ-CT54"),
        ("LENOVO", "Lenovo TB-8704F"),
        ("LGE", "LG-H870"),
        ("HMD Global", "Nokia 6.1"),
    ],
)
def test_a_phone_with_a_maker_s_usual_name_is_named(maker: str, model: str) -> None:
    assert identify({"os": "Android", "manufacturer": maker, "model": model}).named


@pytest.mark.parametrize(
    ("maker", "model"),
    [
        ("Google", "visit my site"),
        ("Google", "Pixel visit"),
        ("Samsung", "SM-HELLO"),
        ("Acme", "X-1"),
        ("", "SM-S918B"),
        ("Simulated", "phone 3 (Mali-like)"),
    ],
)
def test_a_phone_that_no_rule_knows_is_not_named_and_its_address_tells_nothing(
    maker: str, model: str
) -> None:
    identity = identify({"os": "Android", "manufacturer": maker, "model": model})

    assert not identity.named
    assert identity.slug.startswith("unknown-android-device-")


def test_two_phones_that_no_rule_knows_stay_two() -> None:
    first, second = (identify({"os": "Android", "manufacturer": "Acme", "model": m}) for m in ("One", "Two"))

    assert first.key != second.key
    assert first.slug != second.slug


def test_a_pc_that_no_rule_knows_is_named_by_its_processor() -> None:
    identity = identify({"os": "Linux", "manufacturer": "Acme", "model": "My Site", "cpu": "AMD EPYC"})

    assert (identity.manufacturer, identity.name, identity.named) == ("", "AMD EPYC", True)
    assert identity.key == "acme|my site, amd epyc"


def test_a_pc_with_a_known_maker_keeps_it() -> None:
    identity = identify(PC | {"model": "Secret Project"})

    assert (identity.manufacturer, identity.name) == ("Dell", "Intel Core i7-12700H")


def test_two_processors_that_no_rule_knows_stay_two() -> None:
    first, second = (identify({"os": "Linux", "cpu": f"Acme {n} @ 2 GHz"}) for n in ("One", "Two"))

    assert first.key != second.key
    assert not first.named
    assert first.cpu == ""


def test_the_devices_of_a_demo_server_are_named(demo: None) -> None:
    raw = {"os": "Android", "manufacturer": "Simulated", "model": "phone 3 (Mali-like)"}

    assert identify(raw).named
    assert not identify(raw | {"model": "phone 3 (visit-like)"}).named
