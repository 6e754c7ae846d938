"""Probes after a session: what the server assigns, when it is asked for, and what becomes of it."""

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from client_kit.delivery.manifest import Assigned, Manifest
from client_kit.delivery.server import NotFrontrunnerError
from client_kit.delivery.spool import Spool
from client_kit.device import preflight
from client_kit.device.preflight import Concern
from client_kit.home import Home
from client_kit.measuring import probes
from tests.builders import manifests
from tests.client_kit import canned
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import problem
from tests.client_kit.terminal import CHUNKS, Serve, Terminal, canned_measurement, client

__all__ = ["canned_measurement", "client"]

REASONS = {"fine": "few devices have measured it", "rare": "yours predicts it worst"}
THROTTLING = [Concern("throttling", "the device throttles", stops=True)]


def manifest(**changes: Any) -> dict[str, Any]:
    """A manifest over CHUNKS."""
    document = manifests.manifest(CHUNKS)
    document["protocol"]["repeats"] = 4
    return {**document, **changes}


def assigning(*names: str, **changes: Any) -> dict[str, Any]:
    """The manifest for one device, which is to measure `names`."""
    document = manifest()
    default, *_, fine = document["configurations"]
    known = {"fine": fine, "rare": {**fine, "name": "rare", "predicted": {}}}
    document["configurations"] = [default, *(known[name] for name in names)]
    document["protocol"] |= {"order": ["default", *names], "repeats": 2}
    return document | {"assigned": [{"name": name, "why": REASONS[name]} for name in names], **changes}


@pytest.fixture
def counting(tmp_path: Path) -> Counting:
    for chunk in CHUNKS:
        (tmp_path / manifests.digest(chunk)).write_bytes(chunk)
    counting = Counting(manifest(), tmp_path)
    counting.assigned = assigning("fine", "rare")
    return counting


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Have somebody sit at the terminal who types TEXT."""

    def typing(text: str) -> None:
        stdin = io.StringIO(text)
        stdin.isatty = lambda: True  # type: ignore[method-assign]
        monkeypatch.setattr("sys.stdin", stdin)

    return typing


def orders(counting: Counting) -> list[list[str]]:
    return [[run["configuration"] for run in one["runs"]] for one in counting.sessions.values()]


ORDINARY = ["default", "best", "best", "default"] * 2
PROBES = ["default", "fine", "rare", "rare", "fine", "default"]


def test_who_agrees_at_the_terminal_measures_what_is_assigned(
    client: Terminal, serve: Serve, counting: Counting, home: Home, terminal: Any
) -> None:
    terminal("yes\nyes\n")
    server = serve(counting)

    code, out, _ = client("run", "--server", server.url)

    assert code == 0
    assert orders(counting) == [ORDINARY, PROBES]
    assert "fine: few devices have measured it" in out
    assert "Measure 2 more configurations?" in out
    assert out.splitlines()[-1] == "Thank you: predictions now include fine, rare on this device."
    [asked] = [request for request in server.requests if "minutes=" in request.path]
    assert asked.path == "/api/v1/manifest?application=kfusion&minutes=2"
    assert asked.headers["authorization"] == "Bearer secret"
    # The manifest for one device is for now: the front stays as it was.
    assert [kept["manifest"] for path in home.path.glob("*-*.json") if (kept := home.read(path.name))] == [
        counting.manifest
    ] * 2


@pytest.mark.parametrize(
    ("answer", "options"), [("no\n", ()), ("", ()), ("yes\n", ("--no-probes",)), (None, ())]
)
def test_without_a_yes_nothing_further_is_measured(
    answer: str | None, options: tuple[str, ...], client: Terminal, serve: Serve, counting: Counting,
    terminal: Any,
) -> None:  # fmt: skip
    if answer is not None:
        terminal(answer)
    server = serve(counting)

    code, _, _ = client("run", "--yes", "--server", server.url, *options)

    assert code == 0
    assert orders(counting) == [ORDINARY]
    asked = [path for path in server.paths() if "minutes=" in path]
    assert bool(asked) == (answer is not None and not options)


def test_the_option_measures_them_without_a_terminal(
    client: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    code, out, _ = client("run", "--yes", "--probes", "--server", serve(counting).url)

    assert code == 0
    assert "Measure 2 more" not in out
    assert orders(counting) == [ORDINARY, PROBES]
    assert [item.state for item in Spool(home.spool).items()] == ["accepted"] * 2


@pytest.mark.parametrize(
    ("assigned", "said"),
    [
        (None, "Among the others: "),  # an old server, which disregards `minutes`
        (assigning(assigned_message="this device is well known"), "measure: this device is well known"),
        (
            assigning("fine", accepting=False, message="back at noon"),
            "are measured: the server does not accept",
        ),
        (assigning("fine", consent_version=3), "are measured: the consent text has changed"),
        (assigning("fine") | {"configurations": []}, "are measured: the server's manifest lacks"),
    ],
)
def test_where_nothing_is_assigned_the_run_ends_well(
    assigned: dict[str, Any] | None, said: str, client: Terminal, serve: Serve, counting: Counting
) -> None:
    counting.assigned = assigned

    code, out, _ = client("run", "--yes", "--probes", "--server", serve(counting).url)

    assert code == 0
    assert said in out.splitlines()[-1]
    assert orders(counting) == [ORDINARY]


def test_a_server_in_trouble_is_no_failure(client: Terminal, serve: Serve, counting: Counting) -> None:
    server = serve(
        lambda request: (
            problem(503, "busy", "come back later") if "minutes=" in request.path else counting(request)
        )
    )

    code, out, _ = client("run", "--yes", "--probes", "--server", server.url)

    assert code == 0
    assert out.splitlines()[-1] == "No further configurations are measured: come back later (busy)"


def test_chosen_configurations_are_all_that_is_measured(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    server = serve(counting)

    assert client("run", "--yes", "--probes", "--configurations", "fine", "--server", server.url)[0] == 0

    assert len(counting.sessions) == 1
    assert not [path for path in server.paths() if "minutes=" in path]


def test_a_hot_device_is_not_asked_for_more(
    client: Terminal, serve: Serve, counting: Counting, terminal: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal("yes\n")
    looks: Iterator[list[Concern]] = iter([[]])
    monkeypatch.setattr(preflight, "concerns", lambda *_, **__: next(looks, THROTTLING))

    code, out, _ = client("run", "--yes", "--server", serve(counting).url)

    assert code == 0
    assert out.splitlines()[-1] == "No further session: the device throttles"
    assert len(counting.sessions) == 1


@pytest.mark.parametrize(
    ("default", "names"),
    # 26 frames of each: fine takes half of the default's time, rare is taken to need as much as the default.
    [(1.8, ("fine", "rare")), (1.9, ("fine",)), (3.0, ("fine",)), (3.1, ())],
)
def test_what_takes_longer_than_two_minutes_is_dropped_from_the_end(
    default: float, names: tuple[str, ...]
) -> None:
    asked = Manifest.parse(assigning("fine", "rare"))

    assert probes.select_fitting(asked, default) == names
    if names:
        assert probes.seconds(asked.plan(names), asked, default) <= 120


def test_the_predicted_ratio_counts_before_the_predicted_times() -> None:
    document = assigning("fine")
    document["configurations"][1]["predicted"]["runtime_ratio"] = 0.25
    asked = Manifest.parse(document)

    # 2 frames of warm-up and 2 runs of 12 frames: of the default, and of what takes a quarter of its time.
    assert probes.seconds(asked.plan(("fine",)), asked, 1.0) == pytest.approx(26 * 1.25)


def test_configurations_left_out_are_listed() -> None:
    asked = Manifest.parse(assigning("fine", "rare"))

    assert probes.describe(asked, ("fine",))[1:] == [
        "The server assigns further configurations to this device:",
        "  fine: few devices have measured it",
        "Left out, as 2 minutes are too short: rare",
    ]
    assert probes.describe(asked, ()) == [
        "No further configurations are measured: fine, rare would take longer than 2 minutes."
    ]
    assert "Measure 1 more configuration?" in probes.question(("fine",))


def test_a_failed_default_gives_no_estimate() -> None:
    asked = Manifest.parse(manifest())
    whole = canned.measured(asked)
    failed = replace(whole, runs=tuple(replace(run, status="failed") for run in whole.runs))

    assert probes.default_seconds(whole, asked.protocol) == pytest.approx(0.04, rel=0.05)
    assert probes.default_seconds(failed, asked.protocol) is None


def test_assigned_configurations_have_reasons_and_are_in_the_manifest() -> None:
    asked = Manifest.parse(assigning("fine"))
    assert asked.assigned == (Assigned("fine", "few devices have measured it"),)
    assert Manifest.parse(manifest()).assigned == ()

    unknown = assigning("fine") | {"assigned": [{"name": "nowhere", "why": ""}]}
    with pytest.raises(NotFrontrunnerError, match="assigned names 'nowhere'"):
        Manifest.parse(unknown)
