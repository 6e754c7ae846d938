"""Names of devices on an axis: short, and all of them different."""

from crowd.dashboard.figures.elements.names import brief, short_names
from tests.builders.rows import device


def named(*names: str, length: int = 12) -> list[str]:
    return short_names(
        [device(str(number), manufacturer="Samsung", name=name) for number, name in enumerate(names)], length
    )


def test_brackets_and_what_follows_a_comma_go_first_and_the_maker_where_it_does_not_fit() -> None:
    names = "Galaxy S6", "laptop 66 (NVIDIA-like), Intel Core i7"

    assert named(*names) == ["Galaxy S6", "laptop 66"]
    assert named(*names, length=30) == ["Samsung Galaxy S6", "Samsung laptop 66"]
    assert brief("(nothing else)") == "(nothing else)"


def test_the_numbers_of_twins_are_never_cut() -> None:
    chip = "Qualcomm Snapdragon 8 Elite (SM8750) device"

    found = short_names([device(str(number), name=chip) for number in range(11)], 30)

    assert found == [f"Qualcomm Snapdragon 8 Elite {number}" for number in range(1, 12)]


def test_bars_of_one_device_share_its_name_and_what_tells_two_apart_stays() -> None:
    assert short_names([device("x"), device("x"), device("y")], 12) == ["X", "X", "Y"]
    assert named("Pixel (2016)", "Pixel (2023)") == ["Pixel 2016", "Pixel 2023"]
    assert short_names([device("x", manufacturer="Acme", name="")], 12) == ["Acme"]
    assert named("Redmi Note 12 Pro 5G Speed Edition Plus") == ["Redmi No\N{HORIZONTAL ELLIPSIS}lus"]


def test_the_letters_of_masked_models_stay_however_short_the_name() -> None:
    names = [f"Qualcomm Snapdragon 8 Elite (SM8750) device ({letters})" for letters in ("9f5d", "8db8")]

    assert named(*names, length=60) == [
        f"Samsung Qualcomm Snapdragon 8 Elite device ({letters})" for letters in ("9f5d", "8db8")
    ]
    assert named(*names, length=32) == [
        f"Qualcomm Snapdragon 8 Elite {letters}" for letters in ("9f5d", "8db8")
    ]
    assert named(*names, length=12) == [
        f"Qual\N{HORIZONTAL ELLIPSIS}te {letters}" for letters in ("9f5d", "8db8")
    ]


def test_no_two_are_called_the_same() -> None:
    names = [f"Redmi Note {number} Pro Plus" for number in range(10, 24)]

    found = named(*names, length=10)

    assert len(set(found)) == len(names)
    assert max(map(len, found)) <= 10
