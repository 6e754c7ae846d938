import json

import pytest

from groundwork.folders import SEQUENCES
from slam.__main__ import main
from slam.datasets import open_sequence
from slam.datasets.formats.pack import MANIFEST
from slam.datasets.synthetic.prepared import default_folder, make_all
from slam.datasets.synthetic.scenes import SCENES, with_role

DESK = SCENES["desk"]


def made(folder, **options):
    (path,) = make_all([DESK], folder, **{"frames": 2, "ratio": 16} | options)
    return path


def stamp(path):
    return (path / MANIFEST).stat().st_mtime_ns


def test_a_pack_is_made_once_and_then_used(tmp_path):
    first = made(tmp_path)
    written = stamp(first)
    assert first == tmp_path / "desk"
    assert made(tmp_path) == first
    assert stamp(first) == written


@pytest.mark.parametrize("change", [{"frames": 3}, {"ratio": 32}, {"seed": 8}, {"noise": "none"}])
def test_a_pack_of_other_frames_is_made_again(tmp_path, change):
    before = open_sequence(made(tmp_path)).sha256
    assert open_sequence(made(tmp_path, **change)).sha256 != before


def test_a_damaged_pack_is_made_again(tmp_path):
    path = made(tmp_path)
    digest = open_sequence(path).sha256
    for chunk in (path / "chunks").iterdir():
        chunk.write_bytes(b"damaged")
    assert open_sequence(made(tmp_path)).sha256 == digest


@pytest.mark.slow
def test_the_shipped_sequence_is_not_made_again(tmp_path):
    assert make_all([SCENES["living-room"]], tmp_path) == [SEQUENCES / "living-room"]
    assert not list(tmp_path.iterdir())


def test_sequences_lie_in_the_data_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("FRONTRUNNER_VAR", str(tmp_path))
    assert default_folder() == tmp_path / "sequences"


def test_all_that_is_learned_on_or_held_out_is_made_by_one_command(tmp_path, capsys):
    assert main(["datasets", "make", "all", "--frames", "1", "--size", "40x30", "--out", str(tmp_path)]) == 0
    names = [scene.name for scene in (*with_role("learned-on"), *with_role("held-out"))]
    assert capsys.readouterr().out.split() == [str(tmp_path / name) for name in names]
    assert {json.loads(path.read_text())["name"] for path in tmp_path.glob(f"*/{MANIFEST}")} == set(names)


def test_scenes_are_listed_with_their_roles(capsys):
    assert main(["datasets", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for scene in SCENES.values():
        (line,) = [line for line in lines if line.startswith(f"{scene.name} ") and scene.summary in line]
        assert scene.role in line


@pytest.mark.parametrize(
    ("arguments", "message"), [(["desk"], "--out is missing"), (["all", "--colour"], "leave out --colour")]
)
def test_impossible_options_are_refused(capsys, arguments, message):
    assert main(["datasets", "make", *arguments]) == 2
    assert message in capsys.readouterr().err
