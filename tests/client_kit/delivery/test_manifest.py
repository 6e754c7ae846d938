"""What the server asks for: read strictly, kept for days without a network, turned into an order of runs."""

import math
from typing import Any

import pytest

from client_kit.client import Client
from client_kit.delivery import manifest
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import NotFrontrunnerError, Server, UnreachableError
from client_kit.errors import CannotMeasureError, OutdatedError, UsageError
from client_kit.home import Home
from slam.devices.device import BACKENDS
from tests.builders import manifests
from tests.client_kit.scripted import Reply, Request, Serve, always, at_first, problem
from wire.manifest import ContentReference


def asking(document: dict[str, Any] | None = None, **protocol: Any) -> Manifest:
    """The manifest of `document`, an ordinary one unless it is given, with these changes of its protocol."""
    document = document or manifests.manifest()
    document["protocol"] |= protocol
    return Manifest.parse(document)


def with_points(*names: str) -> dict[str, Any]:
    """A manifest with further configurations."""
    document = manifests.manifest()
    document["configurations"] += [manifests.configuration(name, {}) for name in names]
    return document


def test_an_unchanged_manifest_is_not_sent_again(serve: Serve, home: Home) -> None:
    def answer(request: Request) -> Reply:
        if request.headers.get("if-none-match") == '"one"':
            return Reply(304, raw=b"")
        return Reply(200, manifests.manifest(), (("ETag", '"one"'),))

    server = Server(serve(answer).url)

    first, again = manifest.fetch(server, home), manifest.fetch(server, home)

    assert first == again
    assert first[1] is True
    assert first[0].by_name["best"].parameters == {"mu": 0.4}


def test_without_a_network_the_last_manifest_serves(serve: Serve, home: Home) -> None:
    scripted = serve(lambda _: Reply(200, manifests.manifest()))
    server = Server(scripted.url)
    kept, _ = manifest.fetch(server, home)
    scripted.close()

    assert manifest.fetch(server, home) == (kept, False)
    assert manifest.stored_manifests(home) == {(server.url, "kfusion"): kept}


def test_each_application_has_a_manifest_of_its_own(serve: Serve, home: Home) -> None:
    elastic = Reply(200, manifests.manifest(application="elasticfusion"))
    scripted = serve(always("elasticfusion", elastic, lambda _: Reply(200, manifests.manifest())))
    server = Server(scripted.url)

    usual, other = manifest.fetch(server, home)[0], manifest.fetch(server, home, "elasticfusion")[0]

    assert scripted.paths() == ["GET /api/v1/manifest", "GET /api/v1/manifest?application=elasticfusion"]
    assert manifest.stored_manifests(home) == {
        (server.url, "kfusion"): usual,
        (server.url, "elasticfusion"): other,
    }
    client = Client(server.url, home.path)
    assert client.front("elasticfusion") == other
    with pytest.raises(UsageError, match="elasticfusion, kfusion"):
        client.front()
    with pytest.raises(UsageError, match="of orbslam"):
        client.front("orbslam")


def test_a_server_in_trouble_counts_as_away_and_a_refusal_does_not(serve: Serve, home: Home) -> None:
    replies = [Reply(200, manifests.manifest()), Reply(502, raw=b"bad gateway"), problem(404, "not_found")]
    server = Server(serve(at_first("/manifest", *replies)).url)
    manifest.fetch(server, home)

    assert manifest.fetch(server, home)[1] is False
    with pytest.raises(Exception, match="not_found"):
        manifest.fetch(server, home)


def test_a_first_visit_needs_the_server(home: Home, closed_port: int) -> None:
    with pytest.raises(UnreachableError, match="cannot be reached"):
        manifest.fetch(Server(f"http://127.0.0.1:{closed_port}"), home)


def test_a_kept_manifest_of_another_protocol_is_left_out(home: Home) -> None:
    for name, version in (("kfusion", 2), ("elasticfusion", 1)):
        document = manifests.manifest(application=name)
        document["protocol"]["version"] = version
        home.write(f"manifest-{name}.json", {"server": manifests.SERVER, "manifest": document})

    assert set(manifest.stored_manifests(home)) == {(manifests.SERVER, "kfusion")}


def reference(sha256: str) -> dict[str, Any]:
    return {"sha256": sha256, "url": "/"}


@pytest.mark.parametrize(
    ("part", "changes", "message"),
    [
        ("configurations", [], "configurations lacks default"),
        ("configurations", {"band": None}, "field `band` .*configurations"),
        ("configurations", {"trajectory": None}, "field `trajectory` .*configurations"),
        ("configurations", {"band": -1}, r"configurations\[0\].band"),
        ("configurations", {"band": math.nan}, r"configurations\[0\].band"),
        ("configurations", {"trajectory": reference("../../etc")}, r"configurations\[0\].trajectory.sha256"),
        ("configurations", {"trajectory": reference("0" * 64 + "\n")}, r"\[0\].trajectory.sha256"),
        ("protocol", {"order": ["default", "unknown"]}, "protocol.order: 'unknown'"),
        ("protocol", {"order": ["best", "fine"]}, "protocol.order: default is missing"),
        ("protocol", {"first_counted_frame": 12}, "protocol.first_counted_frame: 12"),
        ("protocol", {"warmup_frames": -1}, "protocol.warmup_frames"),
        ("protocol", {"frames": "many"}, "protocol.frames"),
        ("protocol", {"rest_seconds": math.nan}, "protocol.rest_seconds"),
        ("protocol", {"repeats": 26}, "protocol.repeats: 26 of 2 names are 52 runs"),
        ("protocol", {"repeats": 51}, "protocol.repeats"),
        ("sequence", {"sha256": "../../etc"}, "sequence.sha256"),
        ("sequence", None, "sequence"),
        ("sequence", {"colour": {"name": "", "sha256": "..", "chunks": []}}, "sequence.colour.sha256"),
        ("sequence", {"chunks": [reference("../" * 21 + "a") | {"bytes": 1}]}, r"chunks\[0\].sha256"),
        ("sequence", {"chunks": [reference("0" * 64) | {"bytes": 0}]}, r"chunks\[0\].bytes"),
    ],
)
def test_a_manifest_that_is_wrong_is_refused_by_name(part: str, changes: Any, message: str) -> None:
    document = manifests.manifest()
    if not changes:
        document[part] = changes
    else:
        for one in document[part] if isinstance(document[part], list) else [document[part]]:
            one |= changes
            for name in [name for name, value in changes.items() if value is None]:
                del one[name]

    with pytest.raises(NotFrontrunnerError, match=message):
        Manifest.parse(document)


BALANCED = ("default", "best", "best", "default")
THREE = ("default", "best", "best-2", "best-2", "best", "default")


@pytest.mark.parametrize(
    ("asked", "wanted", "plan"),
    [
        (asking(), (), BALANCED),
        (asking(), ("best",), BALANCED),
        (asking(), ("best", "default"), BALANCED),
        (asking(), ("fine",), ("default", "fine", "fine", "default")),
        # As many pairs as the protocol says.
        (asking(repeats=4), (), BALANCED * 2),
        (asking(repeats=4), ("fine",), ("default", "fine", "fine", "default") * 2),
        # Three configurations run forwards and back until each has its repeats.
        (asking(with_points("best-2"), order=[*THREE], repeats=4), (), THREE * 2),
        # An order without repeats is run back and forth.
        (asking(order=["default", "best"], repeats=3), (), (*BALANCED, "default", "best")),
    ],
)
def test_a_session_runs_its_configurations_as_the_protocol_says(
    asked: Manifest, wanted: tuple[str, ...], plan: tuple[str, ...]
) -> None:
    assert asked.plan(wanted) == plan


def test_what_fits_into_one_session_is_one() -> None:
    asked = asking()

    assert asked.plans() == (asked.plan(),)
    assert asked.plans(("all",)) == (("default", "best", "fine", "fine", "best", "default"),)
    assert asked.plans(("fine", "all")) == (asked.plan(("fine", "default", "best")),)
    assert [len(plan) for plan in asking(repeats=4).plans(("all",))] == [12]


def test_a_front_too_large_for_one_session_is_measured_in_several() -> None:
    asked = asking(with_points(*(f"point-{number}" for number in range(35))))

    plans = asked.plans(("all",))

    assert [len(plan) for plan in plans] == [40, 38]
    assert all(plan[0] == plan[-1] == "default" for plan in plans)
    measured = [name for plan in plans for name in set(plan) - {"default"}]
    assert sorted(measured) == sorted(set(asked.by_name) - {"default"})
    assert [len(plan) for plan in asking(repeats=24).plans(("best", "fine"))] == [48, 48]


def test_names_that_the_front_lacks_and_more_runs_than_a_session_holds_are_usage_errors() -> None:
    with pytest.raises(UsageError, match=r"'fast': choose from default, best, fine, all"):
        asking().plan(("fast",))
    many = asking(with_points(*(f"point-{number}" for number in range(23))))
    with pytest.raises(UsageError, match="52 runs are more than the 50"):
        many.plan(list(many.by_name))


def test_an_old_client_is_refused_and_a_pause_is_obeyed() -> None:
    Manifest.parse(manifests.manifest(minimum_app_version="0.1")).require_this_version()
    with pytest.raises(OutdatedError, match=r"0\.10\.0"):
        Manifest.parse(manifests.manifest(minimum_app_version="0.10.0")).require_this_version()
    with pytest.raises(CannotMeasureError, match="does not accept measurements now: try again another day"):
        Manifest.parse(manifests.manifest(accepting=False)).require_accepting()
    with pytest.raises(CannotMeasureError, match="now: back on Monday"):
        Manifest.parse(manifests.manifest(accepting=False, message="back on\nMonday")).require_accepting()


def test_each_configuration_has_a_band_a_reference_and_the_backends_that_can_run_it() -> None:
    document = manifests.manifest()
    document["configurations"][2]["backends"] = ["opencl"]

    asked = Manifest.parse(document)

    best, digest = asked.by_name["best"], manifests.digest(manifests.TRAJECTORY)
    assert (best.band, best.trajectory) == (0.003, ContentReference(digest, f"/trajectories/{digest}"))
    assert best.backends == BACKENDS
    assert asked.by_name["fine"].backends == ("opencl",)


@pytest.mark.parametrize(("version", "older"), [(1, "server"), (3, "client")])
def test_another_protocol_is_not_measured(version: int, older: str) -> None:
    words = f"by protocol 2, the server by {version}: the {older} must be updated"

    with pytest.raises(OutdatedError, match=words):
        asking(version=version)
