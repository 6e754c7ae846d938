"""What the server asks for: read strictly, kept for days without a network, turned into an order of runs."""

from collections.abc import Callable
from typing import Any

import pytest

from client_kit.client import Client
from client_kit.delivery import manifest
from client_kit.delivery.manifest import Manifest, Reference
from client_kit.delivery.server import NotFrontrunnerError, Server, UnreachableError
from client_kit.errors import CannotMeasureError, OutdatedError, UsageError
from client_kit.home import Home
from slam.devices.device import BACKENDS
from tests.builders import manifests
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem

Serve = Callable[..., ScriptedServer]


def protocol(**changes: Any) -> dict[str, Any]:
    return {**manifests.manifest()["protocol"], **changes}


def test_an_unchanged_manifest_is_not_sent_again(serve: Serve, home: Home) -> None:
    def answer(request: Request) -> Reply:
        if request.headers.get("if-none-match") == '"one"':
            return Reply(304, raw=b"")
        return Reply(200, manifests.manifest(), (("ETag", '"one"'),))

    server = Server(serve(answer).url)

    first, again = manifest.fetch(server, home), manifest.fetch(server, home)

    assert first == again
    assert first[1] is True
    assert first[0].configurations["best"].parameters == {"mu": 0.4}


def test_without_a_network_the_last_manifest_serves(serve: Serve, home: Home) -> None:
    scripted = serve(lambda _: Reply(200, manifests.manifest()))
    server = Server(scripted.url)
    kept, _ = manifest.fetch(server, home)
    scripted.close()

    again, fresh = manifest.fetch(server, home)

    assert (again, fresh) == (kept, False)
    assert manifest.stored_manifests(home) == {(server.url, "kfusion"): kept}


def test_each_application_has_a_manifest_of_its_own(serve: Serve, home: Home) -> None:
    def answer(request: Request) -> Reply:
        named = "application=elasticfusion" in request.path
        return Reply(200, manifests.manifest(application="elasticfusion" if named else "kfusion"))

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
    replies = [Reply(200, manifests.manifest()), Reply(502, raw=b"bad gateway"), problem(404, "not_found")]
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
        ({"sequence": {**manifests.manifest()["sequence"], "sha256": "../../etc"}}, "hexadecimal"),
        ({"sequence": None}, "not understood"),
        ({"sequence": {**manifests.manifest()["sequence"], "colour": {"sha256": ".."}}}, "colour"),
    ],
)
def test_a_manifest_that_is_wrong_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(NotFrontrunnerError, match=message):
        Manifest.parse(manifests.manifest(**changes))


def test_a_chunk_whose_name_leaves_the_folder_is_refused() -> None:
    document = manifests.manifest()
    document["sequence"]["chunks"][0]["sha256"] = "../" * 21 + "a"

    with pytest.raises(NotFrontrunnerError, match="chunk"):
        Manifest.parse(document)


def test_the_protocols_order_is_default_best_best_default() -> None:
    asked = Manifest.parse(manifests.manifest())

    expected = ("default", "best", "best", "default")
    assert asked.plan() == expected
    assert asked.plan(("best",)) == expected
    assert asked.plan(("best", "default")) == expected


def test_three_configurations_run_forwards_and_back_until_each_has_its_repeats() -> None:
    names = ["default", "best", "best-2", "best-2", "best", "default"]
    document = manifests.manifest(protocol=protocol(order=names, repeats=4))
    document["configurations"].append(document["configurations"][1] | {"name": "best-2"})

    assert Manifest.parse(document).plan() == (*names, *names)


def test_an_order_without_repeats_is_run_back_and_forth() -> None:
    asked = Manifest.parse(manifests.manifest(protocol=protocol(order=["default", "best"], repeats=3)))

    assert asked.plan() == ("default", "best", "best", "default", "default", "best")


def test_the_whole_front_runs_forwards_and_back() -> None:
    asked = Manifest.parse(manifests.manifest())

    assert asked.plans(("all",)) == (("default", "best", "fine", "fine", "best", "default"),)
    assert asked.plan(("fine",)) == ("default", "fine", "fine", "default")


def test_a_name_that_the_front_lacks_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match=r"'fast': choose from default, best, fine, all"):
        Manifest.parse(manifests.manifest()).plan(("fast",))


def many(points: int) -> Manifest:
    document = manifests.manifest()
    document["configurations"] += [manifests.configuration(f"point-{number}", {}) for number in range(points)]
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


def test_an_old_client_is_refused_and_a_pause_is_obeyed() -> None:
    Manifest.parse(manifests.manifest(minimum_app_version="0.1")).require_this_version()
    with pytest.raises(OutdatedError, match=r"0\.10\.0"):
        Manifest.parse(manifests.manifest(minimum_app_version="0.10.0")).require_this_version()
    with pytest.raises(CannotMeasureError, match="does not accept measurements now: try again another day"):
        Manifest.parse(manifests.manifest(accepting=False)).require_accepting()
    with pytest.raises(CannotMeasureError, match="now: back on Monday"):
        Manifest.parse(manifests.manifest(accepting=False, message="back on\nMonday")).require_accepting()


def test_repeats_that_no_session_holds_are_not_understood() -> None:
    most = Manifest.parse(manifests.manifest(protocol={**protocol(), "repeats": 24}))

    assert [len(plan) for plan in most.plans(("best", "fine"))] == [48, 48]
    for order, repeats in ((["default", "best", "best", "default"], 25), (["default"], 26)):
        asked = {**protocol(), "order": order, "repeats": repeats}
        with pytest.raises(NotFrontrunnerError, match=f"repeats {repeats}"):
            Manifest.parse(manifests.manifest(protocol=asked))


def changed(point: dict[str, Any], lacks: str = "") -> dict[str, Any]:
    """A manifest whose configurations have the members of `point`, and not `lacks`."""
    document = manifests.manifest()
    for configuration in document["configurations"]:
        configuration |= point
        configuration.pop(lacks, None)
    return document


def test_each_configuration_has_a_band_and_a_reference() -> None:
    best = Manifest.parse(manifests.manifest()).configurations["best"]

    digest = manifests.digest(manifests.TRAJECTORY)
    assert (best.band, best.reference) == (0.003, Reference(digest, f"/trajectories/{digest}"))
    assert best.backends == BACKENDS


def test_a_session_has_as_many_pairs_as_the_protocol_says() -> None:
    asked = Manifest.parse(manifests.manifest(protocol=protocol(repeats=4)))

    assert asked.plan() == ("default", "best", "best", "default") * 2
    assert asked.plan(("fine",)) == ("default", "fine", "fine", "default") * 2
    assert [len(plan) for plan in asked.plans(("all",))] == [12]


def test_a_configuration_names_the_backends_that_can_run_it() -> None:
    asked = Manifest.parse(changed({"backends": ["opencl"]}))

    assert asked.configurations["best"].backends == ("opencl",)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (changed({}, lacks="band"), "lacks 'band'"),
        (changed({}, lacks="trajectory"), "lacks 'trajectory'"),
        (changed({"band": -1}), "default has band -1"),
        (changed({"trajectory": {"sha256": "../../etc", "url": "/"}}), "trajectory '../../etc'"),
    ],
)
def test_what_a_configuration_needs_is_refused_by_name_where_it_is_missing(
    document: dict[str, Any], words: str
) -> None:
    with pytest.raises(NotFrontrunnerError, match=words):
        Manifest.parse(document)


@pytest.mark.parametrize(("version", "older"), [(1, "server"), (3, "client")])
def test_another_protocol_is_not_measured(version: int, older: str) -> None:
    with pytest.raises(
        OutdatedError, match=f"by protocol 2, the server by {version}: the {older} must be updated"
    ):
        Manifest.parse(manifests.manifest(protocol=protocol(version=version)))


def test_a_kept_manifest_of_another_protocol_is_left_out(home: Home) -> None:
    for name, version in (("kfusion", 2), ("elasticfusion", 1)):
        document = manifests.manifest(application=name, protocol=protocol(version=version))
        home.write(f"manifest-{name}.json", {"server": manifests.SERVER, "manifest": document})

    assert set(manifest.stored_manifests(home)) == {(manifests.SERVER, "kfusion")}
