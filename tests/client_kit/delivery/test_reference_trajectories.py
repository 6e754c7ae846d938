"""Reference trajectories: fetched once, checked, kept for days without a network."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from client_kit.delivery import reference_trajectories
from client_kit.delivery.downloads import CorruptDownloadError
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.reference_trajectories import deviation
from client_kit.delivery.server import NotFrontrunnerError, Server
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.scripted import Reply, Serve


def test_each_file_is_fetched_once_and_kept(pack: Pack, serve: Serve, home: Home) -> None:
    asked, files = Manifest.parse(room.manifest(pack, far=("best",))), room.TRAJECTORIES
    scripted = serve(lambda request: Reply(200, raw=files[Path(request.path).name]))
    assert not reference_trajectories.all_present(asked, home)

    reference_trajectories.fetch(Server(scripted.url), asked, home)
    scripted.close()

    assert sorted(Path(path).name for path in scripted.paths()) == sorted(files)  # two share one
    assert reference_trajectories.all_present(asked, home)
    kept = reference_trajectories.read(asked, home)
    assert [list(position) for position in kept["default"]] == room.positions()
    assert [list(position) for position in kept["best"]] == room.positions(0.1)


def test_a_file_that_was_damaged_on_disk_is_fetched_again(pack: Pack, serve: Serve, home: Home) -> None:
    asked, digest = Manifest.parse(room.manifest(pack)), manifests.digest(room.NEAR)
    server = Server(serve(lambda _: Reply(200, raw=room.NEAR)).url)
    reference_trajectories.fetch(server, asked, home)
    home.trajectory(digest).write_bytes(b"[]")

    assert not reference_trajectories.all_present(asked, home)
    reference_trajectories.fetch(server, asked, home)

    assert home.trajectory(digest).read_bytes() == room.NEAR


def test_other_bytes_than_promised_are_never_kept(pack: Pack, serve: Serve, home: Home) -> None:
    asked = Manifest.parse(room.manifest(pack))
    server = Server(serve(lambda _: Reply(200, raw=b"[[0, 0, 0]]")).url)

    with pytest.raises(CorruptDownloadError, match="does not match the manifest"):
        reference_trajectories.fetch(server, asked, home, pause=lambda _: None)

    assert not home.trajectory(manifests.digest(room.NEAR)).exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([[0, 0, 0]] * 11, "11 entries"),
        ([[0, 0]] * 12, "12 entries"),
        ([[0, 0, math.nan]] * 12, "not finite"),
        ([0] * 12, "not iterable"),
        ({"positions": 1}, "could not convert"),
    ],
)
def test_what_is_not_a_trajectory_is_refused_by_name(
    content: Any, words: str, pack: Pack, home: Home
) -> None:
    data = json.dumps(content).encode()
    document = room.manifest(pack)
    document["configurations"][1]["trajectory"]["sha256"] = manifests.digest(data)
    for configuration in document["configurations"]:
        digest = configuration["trajectory"]["sha256"]
        path = home.trajectory(digest)
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data if digest == manifests.digest(data) else json.dumps([[0, 0, 0]] * 12).encode())

    with pytest.raises(NotFrontrunnerError, match=f"of best is not a list of 12 positions: .*{words}"):
        reference_trajectories.read(Manifest.parse(document), home)


def test_the_deviation_is_the_largest_distance_of_a_frame_without_alignment() -> None:
    reference = [(1.0, 1.0, 1.0)] * 3

    assert deviation(reference, reference) == 0
    assert deviation([(1.0, 1.0, 1.5), (1.0, 1.0, 1.0), (1.3, 1.4, 1.0)], reference) == pytest.approx(0.5)
    assert deviation([(2.0, 1.0, 1.0)] * 3, reference) == 1  # the same path, elsewhere
    assert math.isnan(deviation([(1.0, 1.0, math.nan), *reference[1:]], reference))
    assert math.isnan(deviation([(1.0, 1.0, math.inf), *reference[1:]], reference))
