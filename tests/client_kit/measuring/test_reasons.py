"""The reason of a failure as it is sent."""

from pathlib import Path

import pytest

from client_kit.measuring import reasons


def test_a_failure_does_not_tell_the_users_name() -> None:
    error = FileNotFoundError(f"{Path.home()}/.cache/kernel missing\nand\x1b[31m more")

    assert reasons.describe(error) == "FileNotFoundError: ~/.cache/kernel missing and [31m more"


@pytest.mark.parametrize(
    ("text", "described"),
    [
        ("clang: /home/anna/x/kernel.cl:3: error", "clang: kernel.cl:3: error"),
        (repr(r"C:\Users\Anna Smith\cache\kernel.cl"), "'kernel.cl'"),
        (r"C:\Users\anna\cache\kernel.cl is gone", "kernel.cl is gone"),
        (
            "compute_size_ratio=7: 320/7 is not a whole number",
            "compute_size_ratio=7: 320/7 is not a whole number",
        ),
    ],
)
def test_a_failure_tells_no_folder(text: str, described: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)

    assert reasons.describe(OSError(text)) == f"OSError: {described}"
