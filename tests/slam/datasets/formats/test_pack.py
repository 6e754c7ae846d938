import json
import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.datasets import DigestError, SequenceError, open_sequence
from slam.datasets.formats import pack
from slam.datasets.formats.pack import Pack
from tests.slam.sequences import ArraySequence, random_poses


def sequence(frames=23, seed=0, **scene):
    rng = np.random.default_rng(seed)
    depth = np.cumsum(rng.integers(-3, 4, (frames, 12, 16)), axis=2) + 2000
    truth = random_poses(frames, rng)
    colour = rng.integers(0, 256, (frames, 12, 16, 3)).astype(np.uint8)
    return ArraySequence(depth, colour, truth, **scene)


@pytest.mark.slow
@given(st.integers(1, 31), st.integers(0, 100))
def test_a_pack_gives_back_depth_camera_stamps_truth_and_scene(tmp_path_factory, frames, seed):
    source = sequence(frames, seed, volume_size=4.8, initial_position=(0.34, 0.5, 0.24))
    source.truth[0] = np.nan
    again = pack.write(source, tmp_path_factory.mktemp("pack"))
    assert len(again) == frames
    assert again.camera == source.camera
    assert again.volume_size == 4.8
    assert again.initial_position == (0.34, 0.5, 0.24)
    np.testing.assert_array_equal(again.timestamps, source.timestamps)
    np.testing.assert_array_equal(again.truth, source.truth)
    for index in np.random.default_rng(seed).permutation(frames):
        np.testing.assert_array_equal(again.depth(index), source.depth(index))


def test_equal_content_has_an_equal_digest_and_other_content_another(tmp_path):
    one = pack.write(sequence(), tmp_path / "one")
    two = pack.write(sequence(), tmp_path / "two")
    other = pack.write(sequence(volume_size=5.0), tmp_path / "other")
    assert one.sha256 == two.sha256
    assert one.sha256 != other.sha256


def test_the_manifest_and_the_chunks_are_all_that_a_client_needs(tmp_path):
    made = pack.write(sequence(), tmp_path / "made")
    sent = json.loads(json.dumps(made.manifest))
    assert set(sent) == {
        "name",
        "sha256",
        "width",
        "height",
        "frames",
        "volume_size",
        "initial_position",
        "chunks",
    }
    received = tmp_path / "received"
    (received / "chunks").mkdir(parents=True)
    for chunk in sent["chunks"]:
        shutil.copy(tmp_path / "made/chunks" / chunk["sha256"], received / "chunks")
        assert (received / "chunks" / chunk["sha256"]).stat().st_size == chunk["bytes"]
    (received / "pack.json").write_text(json.dumps(sent))
    again = Pack(received)
    again.verify()
    np.testing.assert_array_equal(again.depth(22), made.depth(22))


def test_a_changed_byte_is_found_and_named(tmp_path):
    made = pack.write(sequence(), tmp_path)
    victim = tmp_path / "chunks" / made.manifest["chunks"][2]["sha256"]
    data = bytearray(victim.read_bytes())
    data[-1] ^= 1
    victim.write_bytes(data)
    again = Pack(tmp_path)
    again.depth(9)
    with pytest.raises(DigestError, match=r"chunk 2 .* is damaged"):
        again.depth(10)
    with pytest.raises(DigestError, match="chunk 2"):
        again.verify()


def test_a_missing_chunk_is_named(tmp_path):
    made = pack.write(sequence(), tmp_path)
    (tmp_path / "chunks" / made.manifest["chunks"][1]["sha256"]).unlink()
    with pytest.raises(SequenceError, match=r"chunk 1 .* is missing"):
        Pack(tmp_path).depth(0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"volume_size": 9.0}, "volume_size is 9.0 in pack.json and 5.0 in the header"),
        ({"sha256": "0" * 64}, "not the digest of its chunks"),
        ({"chunks": []}, "not a pack"),
        ({"chunks": [{"sha256": "../../secret", "bytes": 3}]}, "64 hexadecimal digits"),
    ],
)
def test_a_manifest_that_lies_is_refused(tmp_path, change, message):
    made = pack.write(sequence(volume_size=5.0), tmp_path)
    (tmp_path / "pack.json").write_text(json.dumps(made.manifest | change))
    with pytest.raises(SequenceError, match=message):
        Pack(tmp_path)


def test_a_manifest_that_is_no_json_is_refused(tmp_path):
    (tmp_path / "pack.json").write_text("{")
    with pytest.raises(SequenceError, match="cannot be read"):
        open_sequence(tmp_path)


def test_writing_again_leaves_no_chunk_behind(tmp_path):
    pack.write(sequence(seed=1), tmp_path)
    made = pack.write(sequence(frames=5, seed=2), tmp_path)
    assert {path.name for path in (tmp_path / "chunks").iterdir()} == {
        chunk["sha256"] for chunk in made.manifest["chunks"]
    }


def test_colour_beside_the_depth_pack_is_found(tmp_path):
    source = sequence()
    source._colour = np.full((23, 12, 16, 3), (200, 100, 50), np.uint8)
    made = pack.write(source, tmp_path / "room")
    assert made.colour(0) is None
    pack.write_colour(source, made, tmp_path / "room-colour")
    again = open_sequence(tmp_path / "room")
    assert np.abs(again.colour(22).astype(int) - (200, 100, 50)).max() <= 4
    with pytest.raises(SequenceError, match="is a colour pack"):
        open_sequence(tmp_path / "room-colour")


def test_colour_of_another_sequence_is_not_taken(tmp_path):
    other = pack.write(sequence(seed=5), tmp_path / "other")
    pack.write_colour(sequence(seed=5), other, tmp_path / "room-colour")
    assert pack.write(sequence(), tmp_path / "room").colour(0) is None


def test_frames_outside_the_sequence_are_refused(tmp_path):
    made = pack.write(sequence(), tmp_path)
    for index in (-1, 23):
        with pytest.raises(IndexError, match="frames 0 to 22"):
            made.depth(index)
