import functools
import http.server
import re
import tarfile
import threading

import numpy as np
import pytest

from slam.__main__ import main
from slam.datasets import SequenceError, open_sequence
from slam.datasets.formats import icl_nuim, tum
from slam.datasets.public.catalogue import ENTRIES, find
from tests.slam.sequences import ArraySequence, random_poses

pytest.importorskip("cv2", reason="image folders need OpenCV")


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def published(tmp_path):
    """A folder, and the address under which its files are served."""
    folder = tmp_path / "published"
    folder.mkdir()
    handler = functools.partial(Quiet, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield folder, f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def sequence():
    rng = np.random.default_rng(0)
    depth = rng.integers(500, 9000, (3, 480, 640))
    return ArraySequence(depth, truth=random_poses(3, rng))


def pack_up(folder, archive, inside):
    with tarfile.open(archive, "w:gz", compresslevel=1) as tar:
        tar.add(folder, inside)


def test_a_sequence_of_tum_is_fetched_and_opens_with_its_camera(tmp_path, published, capsys):
    served, address = published
    tum.write(sequence(), tmp_path / "made")
    (tmp_path / "made/intrinsics.txt").unlink()
    pack_up(tmp_path / "made", served / "x.tgz", "rgbd_dataset_freiburg1_xyz")
    out = tmp_path / "out"
    assert main(["datasets", "get", "fr1_xyz", "--out", str(out), "--address", f"{address}/x.tgz"]) == 0
    said = capsys.readouterr().out
    assert "CC BY 4.0" in said
    assert "gives no checksum, so its SHA-256 was computed and recorded" in said
    assert "3 frames, with truth" in said
    opened = open_sequence(out / "fr1_xyz")
    assert opened.camera.fx == 525
    assert sorted(path.name for path in out.iterdir()) == ["fr1_xyz", "x.tgz.sha256"]
    assert address in (out / "fr1_xyz/SOURCE.txt").read_text()


def test_a_sequence_of_icl_nuim_is_fetched_and_opens_without_more(tmp_path, published):
    served, address = published
    source = sequence()
    source.camera = icl_nuim.CAMERA
    made = tmp_path / "livingRoom2"
    icl_nuim.write(source, made)
    pack_up(made, served / "a.tar.gz", ".")
    out = tmp_path / "out"
    arguments = ["datasets", "get", "icl-kt2", "--out", str(out), "--address", f"{address}/a.tar.gz"]
    assert main([*arguments, "--keep-archive"]) == 0
    opened = open_sequence(out / "icl-kt2")
    assert opened.volume_size == 4.8
    np.testing.assert_array_equal(opened.depth(1), source.depth(1))
    np.testing.assert_allclose(opened.truth, source.truth, atol=1e-7)
    assert (out / "a.tar.gz").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fr9"], "no public sequence 'fr9' is known here: choose one of icl-kt0"),
        (["fr1_xyz", "--address", "{}/none.tgz"], "404"),
        (["fr1_xyz", "--address", "{}/"], "names no file"),
        (["fr1_xyz", "--address", "{}/bad.tgz"], "is damaged or no archive"),
        (["fr1_xyz", "--address", "{}/bad.tgz", "--sha256", "11" * 32], "its publisher gives 11"),
    ],
)
def test_what_cannot_be_had_is_one_line(tmp_path, published, capsys, arguments, message):
    served, address = published
    (served / "bad.tgz").write_bytes(b"<html>moved</html>")
    given = [argument.format(address) for argument in arguments]
    assert main(["datasets", "get", *given, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out/fr1_xyz").exists()


def test_what_is_there_is_not_fetched_again(tmp_path, capsys):
    (tmp_path / "fr1_xyz").mkdir()
    assert main(["datasets", "get", "fr1_xyz", "--out", str(tmp_path)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_the_catalogue_is_printed_and_complete(capsys):
    assert main(["datasets", "get"]) == 0
    said = capsys.readouterr().out
    for name, entry in ENTRIES.items():
        assert name in said
        assert re.fullmatch(r"https://\S+\.t(ar\.)?gz", entry.address)
        assert entry.page.startswith("https://")
        assert entry.licence
        assert entry.citation
        assert entry.sha256 is None
    with pytest.raises(SequenceError, match="choose one of"):
        find("nothing")
