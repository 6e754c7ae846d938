"""Names of devices on an axis: short, and all of them different."""

from crowd.dashboard.figures.elements.names import brief, short_names
from tests.dashboard.rows import device


def named(*names: str, length: int = 12) -> list[str]:
    return short_names([device(name, manufacturer="Samsung", name=name) for name in names], length)


def test_the_maker_brackets_and_what_follows_a_comma_go_first() -> None:
    assert named("Galaxy S6", "laptop 66 (NVIDIA-like), Intel Core i7") == ["Galaxy S6", "laptop 66"]
    assert brief("(nothing else)") == "(nothing else)"


def test_what_tells_two_names_apart_stays() -> None:
    assert named("Pixel (2016)", "Pixel (2023)") == ["Pixel (2016)", "Pixel (2023)"]


def test_long_names_lose_their_middle() -> None:
    assert named("Redmi Note 12 Pro 5G Speed Edition Plus") == ["Redmi No\N{HORIZONTAL ELLIPSIS}lus"]


def test_no_two_are_called_the_same() -> None:
    names = [f"Redmi Note {number} Pro Plus" for number in range(10, 24)]

    found = named(*names, length=10)

    assert len(set(found)) == len(names)
    assert max(map(len, found)) <= 10


def test_a_device_without_a_name_has_its_title() -> None:
    assert short_names([device("x", manufacturer="Acme", name="")], 12) == ["Acme"]
