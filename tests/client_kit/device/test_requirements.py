"""Missing packages of an application are reported before anything is downloaded."""

import pytest

from client_kit.device import requirements
from client_kit.errors import CannotMeasureError, OutdatedError


def test_kinectfusion_needs_nothing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "find_spec", lambda _: None)

    requirements.require("kfusion")


@pytest.mark.parametrize(
    ("android", "command"), [(False, "-m pip install scipy"), (True, "pkg install python-scipy")]
)
def test_a_missing_module_is_an_error_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, android: bool, command: str
) -> None:
    monkeypatch.setattr(requirements, "is_android", lambda _: android)
    monkeypatch.setattr(requirements, "find_spec", lambda module: None if module == "scipy" else module)

    with pytest.raises(CannotMeasureError, match=f"elasticfusion needs scipy.*{command}$"):
        requirements.require("elasticfusion")


def test_an_application_of_a_later_version_wants_an_update() -> None:
    with pytest.raises(OutdatedError, match=r"orbslam.*update"):
        requirements.require("orbslam")
