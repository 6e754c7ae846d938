"""The JSON of docs/data/protocol.md against a real server: what it writes is taken, what it reads is so."""

import json
import re
import urllib.error
import urllib.request
import uuid
from pathlib import Path
from typing import Any

import msgspec
import pytest

from client_kit import choice
from client_kit.delivery import sending
from client_kit.delivery.manifest import Manifest
from client_kit.device import preflight
from client_kit.device.description import FIELDS
from crowd.devices.naming.chips import Processor
from crowd.devices.naming.computing import processor_of
from crowd.devices.naming.raw_device import RawDevice
from crowd.results.intake import checks, schema
from slam.datasets.formats.pack import Pack
from tests.client_kit import canned
from tests.client_kit.published import publish
from wire.front import Errors, Protocol
from wire.manifest import Assignment
from wire.session import SCHEMA_VERSION

PAGE = (Path(__file__).parents[2] / "docs/data/protocol.md").read_text(encoding="utf-8")
EXAMPLES: dict[str, Any] = {
    name: json.loads(text)
    for name, text in re.findall(r"^```json (\w+)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
}


@pytest.fixture
def server(live_server: Any, settings: Any, pack: Pack) -> str:
    """A server that publishes the page's own front."""
    asked = EXAMPLES["manifest"]
    publish(settings, pack, asked["protocol"], asked["configurations"])
    return str(live_server.url)


def call(
    server: str, method: str, path: str, document: Any = None, token: str = "", key: str = ""
) -> tuple[int, Any]:
    body = None if document is None else json.dumps(document).encode()
    headers = {"Content-Type": "application/json", "Authorization": f"Bearer {token}", "Idempotency-Key": key}
    request = urllib.request.Request(f"{server}/api/v1{path}", body, headers, method=method)
    try:
        with urllib.request.urlopen(request) as response:
            return response.status, json.loads(response.read() or "null")
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.loads(error.read())


def assert_described(example: Any, real: Any, where: str) -> None:
    """Every member of `example` is in `real` with a value of the same kind; null fits anything."""
    if example is None or real is None:
        return
    if isinstance(example, dict):
        assert isinstance(real, dict), where
        for name, value in example.items():
            assert name in real, f"{where}.{name}"
            assert_described(value, real[name], f"{where}.{name}")
    elif isinstance(example, list):
        assert isinstance(real, list), where
        for value in real[:1]:
            assert_described(example[0], value, f"{where}[]")
    else:
        kinds = (int, float) if isinstance(example, int | float) else type(example)
        assert isinstance(real, kinds), f"{where} is {real!r}, the page has {example!r}"


def ours(submission: dict[str, Any], manifest: dict[str, Any]) -> dict[str, Any]:
    """The page's submission for the front of this test, with the errors of its reference trajectories."""
    copy: dict[str, Any] = json.loads(json.dumps(submission))
    copy["sessions"][0]["front_version"] = manifest["front_version"]
    errors = {each["name"]: each["reference_ate"] for each in manifest["configurations"]}
    for run in copy["sessions"][0]["runs"]:
        if run["status"] == "ok":
            run |= errors[run["configuration"]]
    return copy


def whole(submission: dict[str, Any]) -> dict[str, Any]:
    """`submission` by another client, with all runs of the protocol. Its best is three times as slow."""
    protocol = EXAMPLES["manifest"]["protocol"]
    [session] = submission["sessions"]
    finished = {run["configuration"]: run for run in session["runs"] if run["status"] == "ok"}
    names = protocol["order"] * (protocol["repeats"] // 2)
    runs = []
    for order, name in enumerate(names):
        times = [(3 if name == "best" else 1) * time + 7 * order for time in finished[name]["frame_us"]]
        place = {"id": str(uuid.uuid4()), "order": order, "repeat": names[:order].count(name)}
        runs.append(finished[name] | place | {"frame_us": times})
    return submission | {"sessions": [session | {"id": str(uuid.uuid4()), "runs": runs}]}


@pytest.mark.slow
def test_what_a_client_reads_and_writes_by_the_page_is_what_the_server_does(server: str) -> None:
    status, manifest = call(server, "GET", "/manifest?application=kfusion")
    assert status == 200
    assert_described(EXAMPLES["manifest"], manifest, "manifest")
    Manifest.parse(EXAMPLES["manifest"])

    status, enrolled = call(server, "POST", "/enrol", EXAMPLES["enrol"])
    assert status == 201
    assert_described(EXAMPLES["enrolled"], enrolled, "enrolled")
    token = enrolled["token"]

    sent = ours(EXAMPLES["submission"], manifest)
    status, dry = call(server, "POST", "/submissions:validate", sent, token)
    assert (status, {item["status"] for item in dry["items"]}) == (200, {"accepted"})
    status, answer = call(server, "POST", "/submissions", sent, token, key="one")
    assert status == 202
    assert_described(EXAMPLES["answer"], answer, "answer")
    assert [item["status"] for item in answer["items"]] == ["accepted"] * 3
    assert call(server, "POST", "/submissions", sent, token, key="one") == (200, answer)

    status, state = call(server, "GET", f"/submissions/{answer['submission_id']}", None, token)
    assert status == 200
    assert state["summarised"] is True
    assert_described(EXAMPLES["state"], state, "state")
    assert state["sessions"][0]["speedups"]

    status, unknown = call(server, "GET", "/recommendation?application=kfusion&max_ate=0.05", None, token)
    assert (status, "no figure" in unknown["detail"]) == (404, True)  # its session lacks runs
    token = call(server, "POST", "/enrol", EXAMPLES["enrol"])[1]["token"]
    assert call(server, "POST", "/submissions", whole(sent), token, key="two")[0] == 202
    status, advice = call(server, "GET", "/recommendation?application=kfusion&max_ate=0.05", None, token)
    assert status == 200, advice
    assert_described(EXAMPLES["recommendation"], advice, "recommendation")
    status, asked = call(server, "GET", "/manifest?application=kfusion&minutes=2", None, token)
    assert status == 200
    assert_described(EXAMPLES["assigned"], asked, "assigned")
    assert_described(EXAMPLES["manifest"], asked, "manifest")
    assert call(server, "DELETE", "/me", None, token)[0] == 204


def test_a_refusal_looks_as_the_page_says(server: str) -> None:
    _, enrolled = call(server, "POST", "/enrol", EXAMPLES["enrol"])
    _, manifest = call(server, "GET", "/manifest?application=kfusion")
    wrong = ours(EXAMPLES["submission"], manifest) | {"app_version": 1}

    status, problem = call(server, "POST", "/submissions", wrong, enrolled["token"], key="one")

    assert_described(EXAMPLES["problem"], problem, "problem")
    assert (status, problem["code"], problem["field"]) == (
        400, EXAMPLES["problem"]["code"], EXAMPLES["problem"]["field"],
    )  # fmt: skip


def test_the_client_itself_sends_what_the_page_says() -> None:
    asked = Manifest.parse(EXAMPLES["manifest"])
    sent = json.loads(json.dumps(canned.payload(asked)))
    page = EXAMPLES["submission"]

    assert_described(page | {"device": {}}, sent, "submission")
    assert set(sent["sessions"][0]) == set(page["sessions"][0])
    assert set(sent["sessions"][0]["runs"][0]) == set(page["sessions"][0]["runs"][0])
    assert set(page["device"]) == set(FIELDS)


def test_the_numbers_of_the_page_bind_each_other() -> None:
    references = {
        each["name"]: msgspec.convert(each["reference_ate"], Errors)
        for each in EXAMPLES["manifest"]["configurations"]
    }
    protocol = msgspec.convert(EXAMPLES["manifest"]["protocol"], Protocol)
    [session] = EXAMPLES["submission"]["sessions"]

    cores = checks.claimed_cores(EXAMPLES["submission"]["device"])
    assert cores == 8
    for run in session["runs"]:
        decoded = msgspec.convert(run, schema.Run)
        assert checks.check_run(decoded, references, protocol, session["stage_clock"], cores) is None


def test_the_page_names_the_answers_that_are_final_and_the_clients_own_limits() -> None:
    finals = re.search(r"^\| ([\d, ]+) \| rejected:", PAGE, re.MULTILINE)
    assert finals is not None
    assert tuple(int(status) for status in finals[1].split(",")) == sending.FINAL
    assert EXAMPLES["submission"]["schema_version"] == SCHEMA_VERSION
    assert all(name in PAGE for name in ("low battery", "power saving", "throttling")), preflight.IGNORABLE


def test_this_client_reads_what_the_page_says_of_probes() -> None:
    asked = EXAMPLES["manifest"]
    [assigned] = EXAMPLES["assigned"]["assigned"]
    probe = {**asked["configurations"][1], "name": assigned["name"]}
    document = {**asked, **EXAMPLES["assigned"], "configurations": [*asked["configurations"], probe]}

    assert Manifest.parse(document).assigned == (Assignment(assigned["name"], assigned["why"]),)
    [best] = choice.predictions(EXAMPLES["recommendation"])
    assert (best.configuration, best.ratio, best.low, best.high) == ("best", 9.1, 8.2, 10.1)


@pytest.mark.parametrize(("example", "chip"), [("vulkan", "Mali-G715"), ("metal", "Apple A17 Pro")])
def test_the_server_names_the_graphics_chip_of_other_interfaces(example: str, chip: str) -> None:
    assert processor_of(RawDevice.parse(EXAMPLES[example])) == Processor(chip, "gpu")
    assert set(EXAMPLES[example]) <= set(FIELDS)
