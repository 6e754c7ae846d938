"""The open data's tests run twice: with a folder, and with a bucket."""

import pytest


@pytest.fixture(autouse=True, params=["folder", pytest.param("bucket", marks=pytest.mark.slow)])
def place(request: pytest.FixtureRequest) -> str:
    """Where exports are."""
    if request.param == "bucket":
        request.getfixturevalue("bucket")
    return str(request.param)
