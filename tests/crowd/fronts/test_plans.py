"""The plans of frames that the manifest names."""

import gzip
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from django.conf import LazySettings
from django.test import Client

from crowd.fronts import manifests, selectors, sequences
from crowd.fronts.content import plans
from crowd.fronts.content.front_file import InvalidFrontError
from crowd.fronts.publishing import services
from crowd.operations import first_run
from slam.configuration import ConfigurationError
from slam.datasets.formats.pack import Pack
from slam.devices.layout import Layout
from slam.kfusion.declarations import ADAPTIVE_KERNELS, VIEW_KERNELS, kernels_of
from slam.kfusion.pipeline import FOLDERS
from slam.plans.plan import SCHEMA
from slam.plans.wasm import MODULE
from slam.registry import frame_plan
from slam.system import scene_of
from tests.builders import stored
from tests.builders.documents import STANDARD, elastic_front_document, front_document
from tests.builders.participant import API
from tests.shipped import FIXTURES, LIVING_ROOM
from wire.front import Front, Point

SHIPPED = {"FRONTRUNNER_FRONTS": FIXTURES / "fronts", "FRONTRUNNER_SEQUENCES": [FIXTURES / "sequences"]}


@pytest.fixture(scope="module")
def published(
    django_db_setup: None, django_db_blocker: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[None]:
    """All tests of the module find the fronts that ship, with plans that are made again."""
    forget_plans()
    with stored.filling(django_db_blocker, tmp_path_factory.mktemp("stored"), **SHIPPED):
        list(first_run.publish_shipped_fronts())
    yield
    with django_db_blocker.unblock():
        stored.empty()


@pytest.fixture
def shipped(published: None, db: None, settings: LazySettings) -> None:
    for name, value in SHIPPED.items():
        setattr(settings, name, value)
    manifests._build.cache_clear()
    plans._plans_of_fronts.cache_clear()


def forget_plans() -> None:
    for cache in (sequences.open_pack, plans._build, plans._plans_of_fronts, manifests._build):
        cache.cache_clear()


def living_room(version: str) -> dict[str, Any]:
    """A front over the sequence that ships."""
    return front_document(json.loads((LIVING_ROOM / "pack.json").read_text()), version)


def configurations(client: Client, application: str) -> dict[str, dict[str, Any]]:
    answer = client.get(f"{API}/manifest?application={application}").json()
    return {each["name"]: each for each in answer["configurations"]}


@pytest.mark.slow
def test_each_configuration_names_its_plan_by_its_digest(client: Client, shipped: None) -> None:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    for configuration in configurations(client, "kfusion").values():
        answer = client.get(configuration["plan"]["url"])
        document = answer.json()

        assert hashlib.sha256(answer.content).hexdigest() == configuration["plan"]["sha256"]
        assert "immutable" in answer.headers["Cache-Control"]
        assert document["configuration"] == configuration["parameters"]
        jsonschema.validate(document, schema)


@pytest.mark.slow
def test_each_configuration_names_the_shaders_of_its_plan_by_their_digest(
    client: Client, shipped: None
) -> None:
    for configuration in configurations(client, "kfusion").values():
        answer = client.get(configuration["shaders"]["url"])
        texts = answer.json()
        launched = {step["kernel"] for step in client.get(configuration["plan"]["url"]).json()["dispatches"]}

        assert hashlib.sha256(answer.content).hexdigest() == configuration["shaders"]["sha256"]
        assert "immutable" in answer.headers["Cache-Control"]
        assert set(texts) == launched
        assert all(f"fn {name}(" in text for name, text in texts.items())


@pytest.mark.slow
def test_each_configuration_names_a_plan_by_rows_and_the_module_for_webassembly(
    client: Client, shipped: None
) -> None:
    for configuration in configurations(client, "kfusion").values():
        wasm = configuration["wasm"]
        answer = client.get(wasm["plan"]["url"])
        document = answer.json()

        assert hashlib.sha256(answer.content).hexdigest() == wasm["plan"]["sha256"]
        assert "immutable" in answer.headers["Cache-Control"]
        assert (document["layout"], document["configuration"]) == ("rows", configuration["parameters"])
        expected = frame_plan(
            "kfusion", document["configuration"], scene_of(Pack(LIVING_ROOM)), Layout("rows")
        )
        assert answer.content.decode() == expected.to_json()


@pytest.mark.slow
def test_the_module_is_served_as_webassembly_under_its_digest(client: Client, shipped: None) -> None:
    modules = [each["wasm"]["module"] for each in configurations(client, "kfusion").values()]
    answer = client.get(modules[0]["url"])

    assert modules == [modules[0]] * len(modules)
    assert answer.content == (FOLDERS[0] / MODULE).read_bytes()
    assert hashlib.sha256(answer.content).hexdigest() == modules[0]["sha256"]
    assert answer.headers["Content-Type"] == "application/wasm"
    assert "immutable" in answer.headers["Cache-Control"]


@pytest.mark.slow
def test_a_volume_beyond_the_limits_of_browsers_is_for_opencl_alone(client: Client, shipped: None) -> None:
    document = living_room("large")
    document["configurations"][2]["parameters"] = STANDARD | {"volume_resolution": 512}
    services.publish_content(document)

    published = configurations(client, "kfusion")

    assert {name: each["backends"] for name, each in published.items()} == {
        "default": ["opencl", "webgpu", "wasm"],
        "best": ["opencl", "webgpu", "wasm"],
        "accurate": ["opencl"],
    }
    assert [name for name, each in published.items() if "wasm" in each] == ["default", "best"]


@pytest.mark.slow
def test_browsers_measure_what_one_of_their_backends_runs_alone(
    shipped: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, without = plans.of_point, dict[str, str]()

    def limited(front: Front, point: Point) -> plans.FramePlan | None:
        made = real(front, point)
        assert made is not None
        return made._replace(backends=tuple(set(made.backends) - {without.get(point.name)}))

    monkeypatch.setattr(plans, "of_point", limited)
    front = selectors.current("kfusion")
    assert front is not None

    for without, measured in (
        ({}, True),
        ({"default": "webgpu", "best": "webgpu"}, True),
        ({"default": "wasm", "best": "wasm"}, True),
        ({"default": "webgpu", "best": "wasm"}, False),
    ):
        assert plans.browsers_measure(front) is measured, without


@pytest.mark.slow
def test_elasticfusion_has_no_plan(client: Client, shipped: None) -> None:
    services.publish_content(elastic_front_document(LIVING_ROOM))

    for configuration in configurations(client, "elasticfusion").values():
        assert configuration["backends"] == ["opencl"]
        assert "plan" not in configuration
        assert "shaders" not in configuration
        assert "wasm" not in configuration


@pytest.mark.slow
@pytest.mark.parametrize(("member", "address"), [("plan", "/plans"), ("shaders", "/shaders")])
def test_an_unknown_digest_is_not_found_nor_a_known_one_sent_twice(
    client: Client, shipped: None, member: str, address: str
) -> None:
    best = configurations(client, "kfusion")["best"]
    again = client.get(best[member]["url"], headers={"If-None-Match": f'"{best[member]["sha256"]}"'})
    other = best["shaders" if member == "plan" else "plan"]["sha256"]

    assert (again.status_code, again.content) == (304, b"")
    assert client.get(f"{address}/{'0' * 64}").status_code == 404
    assert client.get(f"{address}/not-a-digest").status_code == 404
    assert client.get(f"{address}/{other}").status_code == 404


@pytest.mark.slow
def test_an_unknown_module_is_not_found_nor_a_known_one_sent_twice(client: Client, shipped: None) -> None:
    wasm = configurations(client, "kfusion")["best"]["wasm"]
    tag = f'"{wasm["module"]["sha256"]}"'
    again = client.get(wasm["module"]["url"], headers={"If-None-Match": tag})

    assert (again.status_code, again.content) == (304, b"")
    assert client.get(f"/modules/{wasm['plan']['sha256']}").status_code == 404
    assert client.get("/modules/not-a-digest").status_code == 404


@pytest.mark.slow
def test_a_digest_costs_one_query(client: Client, shipped: None, django_assert_max_num_queries: Any) -> None:
    for member in ("plan", "shaders"):
        address = configurations(client, "kfusion")["best"][member]["url"]
        client.get(address)
        with django_assert_max_num_queries(1):
            assert client.get(address).status_code == 200, member


@pytest.mark.slow
def test_a_configuration_that_does_not_fit_the_camera_is_refused_as_a_draft(db: None, shipped: None) -> None:
    document = living_room("odd")
    document["configurations"][2]["parameters"]["compute_size_ratio"] = 7

    with pytest.raises(
        InvalidFrontError, match=r"configurations\[2\].parameters of accurate: compute_size_ratio=7"
    ):
        services.create_draft(document)


@pytest.mark.slow
def test_what_has_no_plan_any_more_is_not_offered_to_clients(
    client: Client, shipped: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise ConfigurationError("mu=0.4: not known any more")

    monkeypatch.setattr(plans, "make", refused)
    manifests._build.cache_clear()

    assert client.get(f"{API}/manifest").json()["code"] == "front_outdated"


@pytest.mark.slow
def test_a_damaged_pack_beside_the_fronts_own_does_no_harm(
    client: Client, shipped: None, settings: LazySettings, tmp_path: Path
) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "pack.json").write_text("{")
    settings.FRONTRUNNER_SEQUENCES = [tmp_path, *settings.FRONTRUNNER_SEQUENCES]
    forget_plans()

    assert "plan" in configurations(client, "kfusion")["best"]


@pytest.mark.parametrize("address", ["plans/0", "shaders/0", "modules/0", "vectors/kfusion.json.gz"])
def test_what_is_named_by_its_digest_can_only_be_read(client: Client, address: str) -> None:
    assert client.post(f"/{address}").status_code == 405


def test_the_golden_vectors_of_every_kernel_are_a_download(client: Client) -> None:
    answer = client.get("/vectors/kfusion.json.gz")
    vectors = json.loads(gzip.decompress(b"".join(answer.streaming_content)))  # type: ignore[arg-type]

    kernels = {vector["plan"]["dispatches"][0]["kernel"] for vector in vectors}
    every = (*kernels_of(Layout("pixels")), *ADAPTIVE_KERNELS, *VIEW_KERNELS)
    assert kernels == {kernel.name for kernel in every}
    assert answer.headers["Content-Type"] == "application/gzip"
