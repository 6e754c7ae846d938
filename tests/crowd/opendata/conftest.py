"""Where exports are: a folder, or a bucket. Only tests of `IN_BOTH_PLACES` use both outside of test-all."""

from types import SimpleNamespace

import pytest

from crowd.results.opendata import rewriting


@pytest.fixture(
    autouse=True,
    params=["folder", pytest.param("bucket", marks=[pytest.mark.slow, pytest.mark.exhaustive])],
)
def place(request: pytest.FixtureRequest) -> str:
    """Where exports are."""
    if request.param == "bucket":
        request.getfixturevalue("bucket")
    return str(request.param)


@pytest.fixture(autouse=True)
def patient_readers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock that ends a rewriting stands still: a busy machine would answer that files are not ready."""
    monkeypatch.setattr(rewriting, "time", SimpleNamespace(monotonic=lambda: 0.0))
