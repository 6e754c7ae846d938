"""Catalogues of Android devices: read, kept, and what they tell of a device."""

from pathlib import Path

import pytest
from django.core.management import CommandError, call_command

from crowd.devices.catalogue import BadLine, CatalogueFileError, look_up, read, store
from crowd.devices.models import CatalogueEntry
from crowd.devices.naming.raw_device import RawDevice
from tests.crowd.recognised import described

PLAY = """Brand,Device,Manufacturer,Model Name,RAM (TotalMem),System on Chip,GPU
samsung,a16x,Samsung,Galaxy A16 5G,3618-7825MB,Samsung s5e8535,2x ARM Mali G68 (950 MHz)
Nothing,Asteroids,Nothing,Nothing Phone (3a),7821MB,QTI SM7635,Qualcomm Adreno 732 (900 MHz)
acme,broken
acme,,Acme,No key,1MB,,
acme,nameless,Acme,,1MB,,
"""
NAMES = """Retail Branding,Marketing Name,Device,Model
Samsung,Galaxy S9,starlte,SM-G960F
Samsung,Galaxy S9,starqltesq,SM-G960U
Acme,Phone One,one,X1
Acme,Phone One Again,one,X1
"""
PHONE = {
    "os": "Android",
    "manufacturer": "samsung",
    "brand": "samsung",
    "model": "SM-A166B",
    "device": "a16x",
}


@pytest.fixture
def play(tmp_path: Path) -> Path:
    path = tmp_path / "play.csv"
    path.write_text(PLAY)
    return path


@pytest.fixture
def names(tmp_path: Path) -> Path:
    """Google's list, in the encoding it comes in."""
    path = tmp_path / "names.csv"
    path.write_bytes(NAMES.encode("utf-16"))
    return path


def test_bad_lines_are_named_and_the_others_taken(db: None, play: Path) -> None:
    done = store(read(play))

    assert (done.read, done.new) == (5, 2)
    assert [(bad.number, bad.reason) for bad in done.bad] == [
        (4, "2 columns instead of 7"),
        (5, "neither a device name nor a code"),
        (6, "no market name"),
    ]


def test_an_import_may_be_repeated(db: None, play: Path) -> None:
    store(read(play))
    before = list(CatalogueEntry.objects.values())

    again = store(read(play))

    assert (again.new, again.changed, again.same) == (0, 0, 2)
    assert list(CatalogueEntry.objects.values()) == before


def test_a_changed_line_changes_its_entry(db: None, play: Path) -> None:
    store(read(play))
    play.write_text(PLAY.replace("Galaxy A16 5G", "Galaxy A16"))

    assert store(read(play)).changed == 1
    assert CatalogueEntry.objects.get(device="a16x").market_name == "Galaxy A16"


def test_utf_16_is_read_and_contradictions_are_named(db: None, names: Path) -> None:
    done = store(read(names))

    assert (done.new, len(done.bad)) == (3, 1)
    assert done.bad[0] == BadLine(5, "line 4 sells it as 'Phone One', this one as 'Phone One Again'")


@pytest.mark.parametrize("content", [b"a,b\n1,2\n", b"", b"Name\nPhone\n"])
def test_another_file_is_refused_with_what_would_be_right(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.csv"
    path.write_bytes(content)

    with pytest.raises(CatalogueFileError, match="a catalogue needs a column Model Name"):
        list(read(path))


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "image.csv"
    path.write_bytes(b"Name,Device\n\xff\xd8\xfa\n")

    with pytest.raises(CatalogueFileError, match="neither UTF-8 nor UTF-16"):
        list(read(path))


def test_a_device_gets_market_name_and_chips_from_the_catalogue(db: None, play: Path) -> None:
    store(read(play))

    model = described(PHONE).model

    assert model.display_name == "Galaxy A16 5G (SM-A166B)"
    assert (model.soc, model.gpu) == ("Samsung Exynos 1330 (S5E8535)", "Mali-G68")


def test_what_the_device_says_itself_comes_first(db: None, play: Path) -> None:
    store(read(play))

    model = described(PHONE | {"soc_model": "s5e8835", "opencl_device": "Mali-G615"}).model

    assert (model.soc, model.gpu) == ("Samsung Exynos 1380 (S5E8835)", "Mali-G615")


def test_another_makers_device_of_the_same_name_is_not_meant(db: None, play: Path) -> None:
    store(read(play))

    assert look_up(RawDevice.parse(PHONE | {"manufacturer": "Acme", "brand": "acme"})).market_name == ""


def test_lines_that_contradict_each_other_tell_nothing(db: None, names: Path) -> None:
    CatalogueEntry.objects.create(maker="acme", device="one", code="", market_name="One", soc="A")
    CatalogueEntry.objects.create(maker="acme", device="one", code="y1", market_name="Other", soc="A")

    entry = look_up(RawDevice.parse({"manufacturer": "Acme", "model": "Z", "device": "one"}))

    assert (entry.market_name, entry.soc) == ("", "A")


def test_a_list_without_makers_counts_where_code_and_device_agree(db: None, tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_text("_id,name,codename,model\n1,Galaxy S9,starlte,SM-G960F\n")
    store(read(path))
    raw = {"manufacturer": "samsung", "model": "SM-G960F", "device": "starlte"}

    assert look_up(RawDevice.parse(raw)).market_name == "Galaxy S9"
    assert look_up(RawDevice.parse(raw | {"device": "other"})).market_name == ""


def test_the_command_names_what_was_known_under_its_code(
    db: None, play: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = described(PHONE).model
    assert model.display_name == "SM-A166B"

    call_command("devices", "import", str(play))

    said = capsys.readouterr().out
    assert "line 4: 2 columns instead of 7" in said
    assert "5 lines: 2 new, 0 changed, 0 unchanged, 3 invalid" in said
    model.refresh_from_db()
    assert model.display_name == "Galaxy A16 5G (SM-A166B)"
    assert model.slug == "samsung-sm-a166b"


def test_the_command_says_what_a_file_lacks(db: None, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="No such file"):
        call_command("devices", "import", str(tmp_path / "absent.csv"))
