"""The Python example of docs/take-part.md, run as it stands, and the commands that the page names."""

import argparse
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from client_kit import cli_options
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Serve

PAGE = Path(__file__).parents[2] / "docs/take-part.md"


def example() -> str:
    [code] = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return code


@pytest.mark.slow
def test_the_example_measures_sends_and_chooses(
    serve: Serve, home: Home, pack: Pack, capsys: pytest.CaptureFixture[str]
) -> None:
    protocol = {**manifests.manifest()["protocol"], "warmup_frames": 0}
    counting = Counting(room.manifest(pack, protocol=protocol), pack._chunks.folder / "chunks")
    names: dict[str, Callable[[str, Path], None]] = {}
    code = example()
    exec(compile(code, str(PAGE), "exec"), names)

    names["measure"](serve(counting).url, home.path)

    output = capsys.readouterr().out
    assert len(code.splitlines()) < 30
    assert "What is sent, with the values of this device" in output
    assert output.count("default ok") == output.count("best ok") == 2
    assert "sent: accepted" in output
    assert "use best" in output or "use default" in output
    [session] = counting.sessions
    assert f"{session} accepted None" in output


def test_the_page_names_every_command_and_option_of_run() -> None:
    page = PAGE.read_text(encoding="utf-8")
    [commands] = [action for action in cli_options.parser()._actions if action.choices]
    choices: dict[str, argparse.ArgumentParser] = dict(commands.choices)  # type: ignore[arg-type]
    run = choices["run"]

    for name in choices:
        assert re.search(rf"`?\b{name}\b", page), name
    for option in run._option_string_actions:
        if option.startswith("--") and option not in ("--help", "--ignore-battery"):
            assert option in page, option
