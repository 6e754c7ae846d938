"""The plans of frames that the manifest names, of the fronts and the sequence that ship."""

import hashlib
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from django.conf import LazySettings
from django.test import Client

from crowd import first_run
from slam.plans.plan import SCHEMA
from tests.crowd.participant import API

FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.fixture
def shipped(db: None, settings: LazySettings) -> None:
    settings.FRONTRUNNER_FRONTS = FIXTURES / "fronts"
    settings.FRONTRUNNER_SEQUENCES = [FIXTURES / "sequences"]
    list(first_run.publish_shipped_fronts())


def configurations(client: Client, application: str) -> dict[str, dict[str, Any]]:
    answer = client.get(f"{API}/manifest?application={application}").json()
    return {each["name"]: each for each in answer["configurations"]}


def test_each_configuration_names_its_plan_by_its_digest(client: Client, shipped: None) -> None:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    for configuration in configurations(client, "kfusion").values():
        answer = client.get(configuration["plan"]["url"])
        document = answer.json()

        assert hashlib.sha256(answer.content).hexdigest() == configuration["plan"]["sha256"]
        assert "immutable" in answer.headers["Cache-Control"]
        assert document["configuration"] == configuration["parameters"]
        jsonschema.validate(document, schema)


def test_a_volume_beyond_webgpus_default_limits_is_for_opencl_alone(client: Client, shipped: None) -> None:
    backends = {name: each["backends"] for name, each in configurations(client, "kfusion").items()}

    assert backends["default"] == backends["best"] == ["opencl", "webgpu"]
    assert backends["fast4"] == backends["accurate"] == ["opencl"]


def test_elasticfusion_has_no_plan(client: Client, shipped: None) -> None:
    for configuration in configurations(client, "elasticfusion").values():
        assert configuration["backends"] == ["opencl"]
        assert "plan" not in configuration


def test_an_unknown_plan_is_not_found_nor_a_known_one_sent_twice(client: Client, shipped: None) -> None:
    plan = configurations(client, "kfusion")["best"]["plan"]
    again = client.get(plan["url"], headers={"If-None-Match": f'"{plan["sha256"]}"'})

    assert (again.status_code, again.content) == (304, b"")
    assert client.get(f"/plans/{'0' * 64}").status_code == 404
