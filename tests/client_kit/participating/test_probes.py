"""Probes after a session: what the server assigns, when it is asked for, and what becomes of it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import NotFrontrunnerError
from client_kit.device import preflight
from client_kit.device.preflight import Concern
from client_kit.home import Home
from client_kit.measuring import probes
from tests.builders import manifests
from tests.builders.screens import Screen
from tests.client_kit import canned
from tests.client_kit.commands import Terminal
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Serve, always, problem
from wire.manifest import Assignment

pytestmark = pytest.mark.usefixtures("canned_measurement")

# Of a configuration without known times.
UNKNOWN = {"runtime": 0, "ate_max": None, "ate_mean": None}
REASONS = {"fine": "few devices have measured it", "rare": "yours predicts it worst"}
THROTTLING = [Concern("throttling", "the device throttles", stops=True)]


def manifest() -> dict[str, Any]:
    """A manifest that asks for four pairs."""
    document = manifests.manifest()
    document["protocol"]["repeats"] = 4
    return document


def assigning(*names: str, **changes: Any) -> dict[str, Any]:
    """The manifest for one device, which is to measure `names`."""
    document = manifest()
    if names:
        default, *_, fine = document["configurations"]
        known = {"fine": fine, "rare": {**fine, "name": "rare", "predicted": UNKNOWN}}
        document["configurations"] = [default, *(known[name] for name in names)]
        document["protocol"] |= {"order": ["default", *names], "repeats": 2}
    return document | {"assigned": [{"name": name, "why": REASONS[name]} for name in names], **changes}


@pytest.fixture
def counting(tmp_path: Path) -> Counting:
    counting = Counting.with_chunks(tmp_path, manifest())
    counting.assigned = assigning("fine", "rare")
    return counting


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Have somebody sit at the terminal who types a text."""

    return lambda text: monkeypatch.setattr("sys.stdin", Screen(text))


def orders(counting: Counting) -> list[list[str]]:
    return [[run["configuration"] for run in one["runs"]] for one in counting.sessions.values()]


ORDINARY = ["default", "best", "best", "default"] * 2
PROBES = ["default", "fine", "rare", "rare", "fine", "default"]


def test_who_agrees_at_the_terminal_measures_what_is_assigned(
    terminal: Terminal, serve: Serve, counting: Counting, home: Home, typed: Callable[[str], None]
) -> None:
    typed("yes\nyes\n")  # to the text of consent, too
    server = serve(counting)

    code, out, _ = terminal("run", "--server", server.url)

    assert (code, orders(counting)) == (0, [ORDINARY, PROBES])
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
    answer: str | None,
    options: tuple[str, ...],
    terminal: Terminal,
    counting: Counting,
    typed: Callable[[str], None],
) -> None:
    if answer is not None:
        typed(answer)

    code, _, _ = terminal.run(counting, *options)

    assert (code, orders(counting)) == (0, [ORDINARY])
    asked = [path for path in terminal.server.paths() if "minutes=" in path]
    assert bool(asked) == (answer is not None and not options)


def test_the_option_measures_them_without_a_terminal(terminal: Terminal, counting: Counting) -> None:
    code, out, _ = terminal.run(counting, "--probes")

    assert (code, "Measure 2 more" in out) == (0, False)
    assert orders(counting) == [ORDINARY, PROBES]
    assert terminal.states() == ["accepted"] * 2


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
        (assigning("fine") | {"configurations": []}, "understood: configurations lacks default"),
    ],
)
def test_where_nothing_is_assigned_the_run_ends_well(
    assigned: dict[str, Any] | None, said: str, terminal: Terminal, counting: Counting
) -> None:
    counting.assigned = assigned

    code, out, _ = terminal.run(counting, "--probes")

    assert (code, orders(counting)) == (0, [ORDINARY])
    assert said in out.splitlines()[-1]


def test_a_server_in_trouble_is_no_failure(terminal: Terminal, counting: Counting) -> None:
    trouble = problem(503, "busy", "come back later")

    code, out, _ = terminal.run(always("minutes=", trouble, counting), "--probes")

    assert code == 0
    assert out.splitlines()[-1] == "No further configurations are measured: come back later (busy)"


def test_chosen_configurations_are_all_that_is_measured(terminal: Terminal, counting: Counting) -> None:
    assert terminal.run(counting, "--probes", "--configurations", "fine")[0] == 0

    assert len(counting.sessions) == 1
    assert not [path for path in terminal.server.paths() if "minutes=" in path]


def test_a_hot_device_is_not_asked_for_more(
    terminal: Terminal, counting: Counting, typed: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    typed("yes\n")
    looks: Iterator[list[Concern]] = iter([[]])
    monkeypatch.setattr(preflight, "concerns", lambda *_, **__: next(looks, THROTTLING))

    code, out, _ = terminal.run(counting)

    assert (code, len(counting.sessions)) == (0, 1)
    assert out.splitlines()[-1] == "No further session: the device throttles"


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
    assert asked.assigned == (Assignment("fine", "few devices have measured it"),)
    assert Manifest.parse(manifest()).assigned == ()

    unknown = assigning("fine") | {"assigned": [{"name": "nowhere", "why": ""}]}
    with pytest.raises(NotFrontrunnerError, match="assigned names 'nowhere'"):
        Manifest.parse(unknown)
