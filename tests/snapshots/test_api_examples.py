"""The examples of the API pages hold: each is asked again, as the pages write it, and answered alike.

`pytest tests/snapshots --write-snapshots` stores them again.
"""

import json
import os
import re
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import pytest
from django.test import override_settings

from crowd.api_pages import calls, snippets
from crowd.api_pages.examples import FILE, examples
from crowd.api_pages.openapi import document
from crowd.explorations.models import Exploration
from crowd.fronts.publishing.services import publish_content
from tests.builders import documents
from tests.explorations.conftest import exploration, tiny_pack, unsaved  # noqa: F401 - fixtures
from tests.snapshots.api_example_server import WISHES, ExampleServer, Wish, wanted
from tests.snapshots.fixed import World, world

FRAMES = 8
# Their bodies name sessions and runs by ids that may come once, or what a lease asked for.
NEW_IDS = ("submit", "validate", "result")
SECRETS = ("token", "page")


@pytest.fixture
def fixed(transactional_db: None, own_data_folder: Path) -> Iterator[World]:
    """The world, in which no device is rare."""
    with world(own_data_folder) as fixed, override_settings(FRONTRUNNER_RARE_BELOW=1, FRONTRUNNER_QUORUM=1):
        fixed.begin("examples")
        yield fixed


@pytest.fixture
def server(
    fixed: World,
    demo: None,
    exploration: Exploration,  # noqa: F811
    own_data_folder: Path,
    settings: Any,
    live_server: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> ExampleServer:
    """One whose sequence has few frames, so that whole sessions can be read on a page."""
    settings.FRONTRUNNER_SEQUENCES = [own_data_folder / "sequences", *settings.FRONTRUNNER_SEQUENCES]
    monkeypatch.setattr(documents, "FRAMES", FRAMES)
    monkeypatch.setattr("crowd.demo.mark._admitting", True)
    front = documents.front_document(documents.write_pack(own_data_folder / "sequences"))
    front["protocol"] |= {"warmup_frames": 2, "first_counted_frame": 2}
    publish_content(front)
    return ExampleServer(live_server.url, exploration)


def same(expected: Any, actual: Any, path: str = "") -> list[str]:
    """Where the shapes differ. null fits everything, and an empty array every array."""
    if expected is None or actual is None:
        return []
    if isinstance(expected, dict) and isinstance(actual, dict):
        named = {"parameters", "stages_us", "stages", "objectives", "configuration", "results_per_space"}
        if path.rsplit(".", 1)[-1] not in named and expected.keys() != actual.keys():
            return [f"{path}: {sorted(expected.keys() ^ actual.keys())}"]
        return [
            text
            for name in expected.keys() & actual.keys()
            for text in same(expected[name], actual[name], f"{path}.{name}")
        ]
    if isinstance(expected, list) and isinstance(actual, list):
        return same(expected[0], actual[0], f"{path}[]") if expected and actual else []
    return [] if kind(expected) == kind(actual) else [f"{path}: {expected!r} and {actual!r}"]


def kind(value: Any) -> type:
    return float if isinstance(value, int) and not isinstance(value, bool) else type(value)


def run_python(lines: str, token: str) -> Any:
    """The answer that `lines` of a page end with."""
    os.environ["TOKEN"] = token
    names: dict[str, Any] = {}
    exec(compile(lines, "page", "exec"), names)
    return names["answer"]


def run_curl(lines: str, token: str) -> Any:
    """What the command of a page prints."""
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", f"{lines} --fail"],
        env=os.environ | {"TOKEN": token},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, (lines, done.stderr)
    return json.loads(done.stdout) if done.stdout else None


def request_on(server: ExampleServer, key: str, wish: Wish) -> snippets.Request:
    """The example of the page of `key`, with the places of `server` and ids that it does not know yet."""
    method, path, operation = calls.operations(document())[key]
    request = snippets.request_of(server.url, method, path, operation, wish.path)
    body = wish.body if key in NEW_IDS else request.body
    headers = request.headers | wish.headers
    return replace(request, body=body, headers=headers)


def write(server: ExampleServer, fixed: World) -> None:
    """Ask `server` for every example, and store it without secrets."""
    stored = {}
    for key in WISHES:
        fixed.begin(key)
        wish = wanted(server, key)
        method, path, _ = calls.operations(document())[key]
        for name, value in wish.path.items():
            path = path.replace(f"{{{name}}}", value)
        answered = server.ask(
            method, f"{path}?{urlencode(wish.query)}", wish.body, wish.token, **wish.headers
        )
        assert answered.status < 300, (key, answered)
        stored[key] = {"status": answered.status} | {
            name: value for name in ("path", "query", "headers", "body") if (value := getattr(wish, name))
        }
        if answered.content is not None:
            stored[key]["answer"] = hidden(answered.content)
    for key in ("speedups", "devices", "sessions", "runs", "exploration"):
        following = stored[key]["answer"]["next"]
        stored[key]["parameters"] = {"cursor": parse_qs(urlsplit(following).query)["cursor"][0]}
    stored["runs"]["parameters"]["session"] = stored["session"]["path"]["key"]
    FILE.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n")
    examples.cache_clear()
    document.cache_clear()


def hidden(value: Any) -> Any:
    """`value` without tokens and private pages."""
    if isinstance(value, dict):
        return {name: "…" if name in SECRETS else hidden(each) for name, each in value.items()}
    return [hidden(each) for each in value] if isinstance(value, list) else value


@pytest.mark.slow
def test_every_example_is_answered_as_its_page_says(
    server: ExampleServer,
    fixed: World,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    pytestconfig: pytest.Config,
) -> None:
    if pytestconfig.getoption("--write-snapshots", default=False):
        write(server, fixed)
    fixed.begin("questions")
    monkeypatch.chdir(tmp_path)
    differing = []
    for key, example in examples().items():
        for run, lines in ((run_curl, snippets.curl), (run_python, snippets.python)):
            wish = wanted(server, key)
            request = request_on(server, key, wish)
            Path(snippets.BODY_FILE).write_text(json.dumps(request.body))
            answer = run(lines(request), wish.token)
            differing += [f"{key}: {text}" for text in same(example.get("answer"), answer)]
            assert (answer is None) == ("answer" not in example), key
    assert differing == []
    assert_parameters(server)


def assert_parameters(server: ExampleServer) -> None:
    """The example of each query parameter is taken beside the example's others."""
    for key, (method, path, operation) in calls.operations(document()).items():
        wish = wanted(server, key) if method == "GET" else Wish()
        for name, value in wish.path.items():
            path = path.replace(f"{{{name}}}", value)
        for one in operation.get("parameters", ()):
            if one["in"] != "query" or one["name"] == "cursor":
                continue
            value = server.session if one["name"] == "session" else one["example"]
            token = server.submitted()[0] if one["name"] == "minutes" else wish.token
            # A device is named in one way.
            alone = key == "recommendation" and one["name"] in ("gpu", "soc")
            query = urlencode(({} if alone else wish.query) | {one["name"]: value})
            answered = server.ask(method, f"{path}?{query}", token=token)
            assert answered.status == 200, (key, one["name"], answered.content)


def test_every_call_has_an_example_and_every_parameter_too() -> None:
    operations = calls.operations(document())

    assert examples().keys() == WISHES.keys() == operations.keys()
    for key, (_, _, operation) in operations.items():
        for one in operation.get("parameters", ()):
            assert one["example"] != "" or one["name"] == "cursor", (key, one["name"])
            assert one.get("description") or one["in"] == "path", (key, one["name"])


def test_no_example_has_a_secret_or_a_device_that_exists() -> None:
    text = FILE.read_text()

    assert set(re.findall(r'"(?:token|page)": "([^"]*)"', text)) == {"…"}
    for key in ("devices", "speedups", "device"):
        answer = examples()[key]["answer"]
        for row in answer.get("results", [answer]):
            assert row["simulated"] is True
