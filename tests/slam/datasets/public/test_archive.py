import io
import tarfile
import zipfile

import pytest

from slam.datasets.public.archive import ArchiveError, unpack


def tar(path, *members, mode="w:gz"):
    """Members are names with bytes, names alone for folders, or whole TarInfos."""
    with tarfile.open(path, mode) as archive:
        for member in members:
            if isinstance(member, tarfile.TarInfo):
                archive.addfile(member)
                continue
            name, data = member if isinstance(member, tuple) else (member, None)
            info = tarfile.TarInfo(name)
            if data is None:
                info.type = tarfile.DIRTYPE
                archive.addfile(info)
            else:
                info.size = len(data)
                archive.addfile(info, io.BytesIO(data))
    return path


def link(name, to, kind=tarfile.SYMTYPE):
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, to
    return info


@pytest.mark.parametrize("mode", ["w", "w:gz", "w:bz2", "w:xz"])
def test_a_tar_of_any_compression_is_unpacked(tmp_path, mode):
    archive = tar(tmp_path / "a.tgz", "depth", ("depth/0.png", b"0"), ("./x.txt", b"x"), mode=mode)
    unpack(archive, tmp_path / "room")
    assert (tmp_path / "room/depth/0.png").read_bytes() == b"0"
    assert (tmp_path / "room/x.txt").read_bytes() == b"x"


def test_a_single_folder_at_the_top_becomes_the_folder(tmp_path):
    unpack(tar(tmp_path / "a.tgz", ("rgbd_x/depth/0.png", b"0")), tmp_path / "room")
    assert (tmp_path / "room/depth/0.png").read_bytes() == b"0"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tgz", "room"]


def test_depth_alone_is_no_such_folder(tmp_path):
    unpack(tar(tmp_path / "a.tgz", ("depth/0.png", b"0")), tmp_path / "room")
    assert (tmp_path / "room/depth/0.png").exists()


def test_a_zip_is_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("room/", b"")
        archive.writestr("room/depth/0.png", b"0")
    unpack(tmp_path / "a.zip", tmp_path / "out")
    assert (tmp_path / "out/depth/0.png").read_bytes() == b"0"


@pytest.mark.parametrize(
    "member",
    [
        ("../evil", b"x"),
        ("a/../../evil", b"x"),
        ("/tmp/evil", b"x"),
        ("C:\\evil", b"x"),
        ("..\\evil", b"x"),
        "../evil",
        link("a", "/etc"),
        link("a", "../evil"),
        link("a", "../evil", tarfile.LNKTYPE),
        link("a", "", tarfile.CHRTYPE),
        link("a", "", tarfile.FIFOTYPE),
    ],
)
def test_a_tar_that_reaches_outside_is_refused_and_leaves_nothing(tmp_path, member):
    inner = tmp_path / "inner"
    inner.mkdir()
    archive = tar(tmp_path / "a.tgz", ("fine", b"x"), member)
    with pytest.raises(ArchiveError):
        unpack(archive, inner / "room")
    assert list(inner.iterdir()) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tgz", "inner"]


@pytest.mark.parametrize(("name", "mode"), [("../evil", 0o100644), ("/evil", 0o100644), ("a", 0o120777)])
def test_a_zip_that_reaches_outside_is_refused(tmp_path, name, mode):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        info = zipfile.ZipInfo(name)
        info.external_attr = mode << 16
        archive.writestr(info, b"../x")
    with pytest.raises(ArchiveError):
        unpack(tmp_path / "a.zip", tmp_path / "room")
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


@pytest.mark.parametrize("keep", [0, 10, 0.5, -1])
def test_a_damaged_archive_is_refused_and_leaves_nothing(tmp_path, keep):
    archive = tar(tmp_path / "a.tgz", *((f"d/{i}", bytes(range(256)) * 40) for i in range(20)))
    data = archive.read_bytes()
    archive.write_bytes(data[: int(keep * len(data)) if isinstance(keep, float) else keep])
    with pytest.raises(ArchiveError, match="fetch it again"):
        unpack(archive, tmp_path / "room")
    assert [path.name for path in tmp_path.iterdir()] == ["a.tgz"]


def test_what_is_there_is_not_overwritten(tmp_path):
    (tmp_path / "room").mkdir()
    with pytest.raises(ArchiveError, match="exists already"):
        unpack(tar(tmp_path / "a.tgz", ("x", b"")), tmp_path / "room")


def test_an_empty_archive_is_refused(tmp_path):
    with pytest.raises(ArchiveError, match="holds no file"):
        unpack(tar(tmp_path / "a.tgz"), tmp_path / "room")
