"""What the server asks for: read strictly, kept for days without a network, turned into an order of runs."""

from collections.abc import Callable
from typing import Any

import pytest

from client_kit.client import Client
from client_kit.delivery import manifest
from client_kit.delivery.manifest import AdaptiveRepeats, Manifest, Reference
from client_kit.delivery.server import NotFrontrunnerError, Server, UnreachableError
from client_kit.errors import CannotMeasureError, OutdatedError, UsageError
from client_kit.home import Home
from tests.client_kit import documents
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem

Serve = Callable[..., ScriptedServer]


def protocol(**changes: Any) -> dict[str, Any]:
    return {**documents.manifest()["protocol"], **changes}


def adaptive(asked: Manifest) -> AdaptiveRepeats:
    assert asked.protocol.adaptive is not None
    return asked.protocol.adaptive


def test_an_unchanged_manifest_is_not_sent_again(serve: Serve, home: Home) -> None:
    def answer(request: Request) -> Reply:
        if request.headers.get("if-none-match") == '"one"':
            return Reply(304, raw=b"")
        return Reply(200, documents.manifest(), (("ETag", '"one"'),))

    server = Server(serve(answer).url)

    first, again = manifest.fetch(server, home), manifest.fetch(server, home)

    assert first == again
    assert first[1] is True
    assert first[0].configurations["best"].parameters == {"mu": 0.4}


def test_without_a_network_the_last_manifest_serves(serve: Serve, home: Home) -> None:
    scripted = serve(lambda _: Reply(200, documents.manifest()))
    server = Server(scripted.url)
    kept, _ = manifest.fetch(server, home)
    scripted.close()

    again, fresh = manifest.fetch(server, home)

    assert (again, fresh) == (kept, False)
    assert manifest.stored_manifests(home) == {(server.url, "kfusion"): kept}


def test_each_application_has_a_manifest_of_its_own(serve: Serve, home: Home) -> None:
    def answer(request: Request) -> Reply:
        named = "application=elasticfusion" in request.path
        return Reply(200, documents.manifest(application="elasticfusion" if named else "kfusion"))

    scripted = serve(answer)
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
    replies = [Reply(200, documents.manifest()), Reply(502, raw=b"bad gateway"), problem(404, "not_found")]
    scripted: ScriptedServer = serve(lambda _: replies[len(scripted.requests) - 1])
    server = Server(scripted.url)
    manifest.fetch(server, home)

    assert manifest.fetch(server, home)[1] is False
    with pytest.raises(Exception, match="not_found"):
        manifest.fetch(server, home)


def test_a_first_visit_needs_the_server(home: Home, closed_port: int) -> None:
    with pytest.raises(UnreachableError, match="cannot be reached"):
        manifest.fetch(Server(f"http://127.0.0.1:{closed_port}"), home)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"configurations": []}, "configurations: default"),
        ({"protocol": protocol(order=["default", "unknown"])}, "unknown"),
        ({"protocol": protocol(first_counted_frame=12)}, "out of range"),
        ({"protocol": protocol(frames="many")}, "many"),
        ({"sequence": {**documents.manifest()["sequence"], "sha256": "../../etc"}}, "hexadecimal"),
        ({"sequence": None}, "not understood"),
        ({"sequence": {**documents.manifest()["sequence"], "colour": {"sha256": ".."}}}, "colour"),
    ],
)
def test_a_manifest_that_is_wrong_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(NotFrontrunnerError, match=message):
        Manifest.parse(documents.manifest(**changes))


def test_a_chunk_whose_name_leaves_the_folder_is_refused() -> None:
    document = documents.manifest()
    document["sequence"]["chunks"][0]["sha256"] = "../" * 21 + "a"

    with pytest.raises(NotFrontrunnerError, match="chunk"):
        Manifest.parse(document)


def test_the_protocols_order_is_default_best_best_default() -> None:
    asked = Manifest.parse(documents.manifest())

    expected = ("default", "best", "best", "default")
    assert asked.plan() == expected
    assert asked.plan(("best",)) == expected
    assert asked.plan(("best", "default")) == expected


def test_an_order_without_repeats_is_run_back_and_forth() -> None:
    asked = Manifest.parse(documents.manifest(protocol=protocol(order=["default", "best"], repeats=3)))

    assert asked.plan() == ("default", "best", "best", "default", "default", "best")


def test_the_whole_front_runs_forwards_and_back() -> None:
    asked = Manifest.parse(documents.manifest())

    assert asked.plans(("all",)) == (("default", "best", "fine", "fine", "best", "default"),)
    assert asked.plan(("fine",)) == ("default", "fine", "fine", "default")


def test_a_name_that_the_front_lacks_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match=r"'fast': choose from default, best, fine, all"):
        Manifest.parse(documents.manifest()).plan(("fast",))


def many(points: int) -> Manifest:
    document = documents.manifest()
    document["configurations"] += [
        {"name": f"point-{number}", "parameters": {}, "predicted": {}} for number in range(points)
    ]
    return Manifest.parse(document)


def test_a_front_too_large_for_one_session_is_measured_in_several() -> None:
    asked = many(35)

    plans = asked.plans(("all",))

    assert [len(plan) for plan in plans] == [40, 38]
    assert all(plan[0] == plan[-1] == "default" for plan in plans)
    measured = [name for plan in plans for name in set(plan) - {"default"}]
    assert sorted(measured) == sorted(set(asked.configurations) - {"default"})


def test_what_fits_into_one_session_is_one() -> None:
    asked = many(0)

    assert asked.plans() == (asked.plan(),)
    assert asked.plans(("all",)) == (asked.plan(("default", "best", "fine")),)
    assert asked.plans(("fine", "all")) == (asked.plan(("fine", "default", "best")),)


def test_more_runs_than_a_session_holds_are_a_usage_error() -> None:
    asked = many(23)

    with pytest.raises(UsageError, match="52 runs are more than the 50"):
        asked.plan(list(asked.configurations))


def test_how_far_a_session_goes_on_is_the_protocols_or_the_clients_own() -> None:
    silent = Manifest.parse(documents.manifest(protocol={**protocol(), "repeats": 8, "max_repeats": 4}))
    own = {name: value for name, value in protocol().items() if name != "max_repeats"}
    told = Manifest.parse(documents.manifest(protocol={**own, "precision": 0.02, "max_seconds": 30}))

    assert adaptive(silent).max_repeats == 8  # never fewer than are asked for anyway
    assert adaptive(told) == AdaptiveRepeats(max_repeats=6, precision=0.02, max_seconds=30.0)


def test_an_old_client_is_told_to_update_and_a_pause_is_obeyed() -> None:
    Manifest.parse(documents.manifest(minimum_app_version="0.1")).require_this_version()
    with pytest.raises(OutdatedError, match=r"0\.10\.0"):
        Manifest.parse(documents.manifest(minimum_app_version="0.10.0")).require_this_version()
    with pytest.raises(CannotMeasureError, match="does not accept measurements now: try again another day"):
        Manifest.parse(documents.manifest(accepting=False)).require_accepting()
    with pytest.raises(CannotMeasureError, match="now: back on Monday"):
        Manifest.parse(documents.manifest(accepting=False, message="back on\nMonday")).require_accepting()


def test_repeats_that_no_session_holds_are_not_understood() -> None:
    most = Manifest.parse(documents.manifest(protocol={**protocol(), "repeats": 24}))

    assert [len(plan) for plan in most.plans(("best", "fine"))] == [48, 48]
    for order, repeats in ((["default", "best", "best", "default"], 25), (["default"], 26)):
        asked = {**protocol(), "order": order, "repeats": repeats}
        with pytest.raises(NotFrontrunnerError, match=f"repeats {repeats}"):
            Manifest.parse(documents.manifest(protocol=asked))


SHA256 = "5a" * 32


def protocol_2(point: dict[str, Any] | None = None, lacks: str = "", **changes: Any) -> dict[str, Any]:
    """A manifest of protocol 2 whose configurations have the members of POINT, and not LACKS."""
    told = {name: value for name, value in protocol().items() if name != "max_repeats"}
    document = documents.manifest(protocol={**told, "version": 2, "repeats": 4, **changes})
    for configuration in document["configurations"]:
        configuration |= {"band": 0.003, "trajectory": {"sha256": SHA256, "url": f"/trajectories/{SHA256}"}}
        configuration |= point or {}
        configuration.pop(lacks, None)
    return document


def test_protocol_2_has_bands_references_and_a_fixed_number_of_pairs() -> None:
    asked = Manifest.parse(protocol_2())

    best = asked.configurations["best"]
    assert (best.band, best.reference) == (0.003, Reference(SHA256, f"/trajectories/{SHA256}"))
    assert asked.protocol.adaptive is None
    assert asked.plan() == ("default", "best", "best", "default") * 2
    assert asked.plan(("fine",)) == ("default", "fine", "fine", "default") * 2
    assert [len(plan) for plan in asked.plans(("all",))] == [12]


def test_protocol_1_has_neither_bands_nor_references() -> None:
    best = Manifest.parse(documents.manifest()).configurations["best"]

    assert (best.band, best.reference, best.backends) == (None, None, ("opencl", "webgpu"))


def test_a_configuration_names_the_backends_that_can_run_it() -> None:
    asked = Manifest.parse(protocol_2({"backends": ["opencl"]}))

    assert asked.configurations["best"].backends == ("opencl",)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (protocol_2(lacks="band"), "lacks 'band'"),
        (protocol_2(lacks="trajectory"), "lacks 'trajectory'"),
        (protocol_2({"band": -1}), "default has band -1"),
        (protocol_2({"trajectory": {"sha256": "../../etc", "url": "/"}}), "trajectory '../../etc'"),
    ],
)
def test_what_protocol_2_needs_is_refused_by_name_where_it_is_missing(
    document: dict[str, Any], words: str
) -> None:
    with pytest.raises(NotFrontrunnerError, match=words):
        Manifest.parse(document)


def test_a_protocol_of_the_future_asks_for_a_newer_client() -> None:
    with pytest.raises(OutdatedError, match="knows protocol 1 and 2, the server uses 3: update the client"):
        Manifest.parse(documents.manifest(protocol=protocol(version=3)))
