"""docs/data/api.md is true: its client runs, its limits are the settings', its calls are the API's."""

import json
import re
import shutil
import subprocess
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from crowd.api_pages.openapi import document
from crowd.fronts.models import FrontVersion
from crowd.http import json_limits
from crowd.results.intake import daily_limits
from crowd.results.models import Submission
from tests.builders.documents import submission_document

ROOT = Path(__file__).resolve().parents[3]
DOCUMENT = (ROOT / "docs" / "data" / "api.md").read_text()
SERVER = "http://127.0.0.1:8000"


@pytest.fixture
def run(tmp_path: Path, live_server: Any) -> Callable[[str], list[str]]:
    """Runs a script of the document against the live server; the lines that it prints."""
    for program in ("bash", "curl", "gzip", "sed"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed here")

    def lines(script: str) -> list[str]:
        assert SERVER in script
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", script.replace(SERVER, live_server.url)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return lines


def test_the_client_in_ten_lines_works(
    transactional_db: None, front: FrontVersion, run: Callable[[str], list[str]], tmp_path: Path
) -> None:
    (script,) = re.findall(r"```bash\n(.*?)```", DOCUMENT, re.S)
    (tmp_path / "submission.json").write_text(json.dumps(submission_document()))
    assert len(script.strip().splitlines()) <= 11

    checked, again, state, erased = run(script)

    assert json.loads((tmp_path / "manifest.json").read_text())["front_version"] == "kfusion-test"
    assert {item["status"] for item in json.loads(checked)["items"]} == {"accepted"}
    assert {item["status"] for item in json.loads(again)["items"]} == {"accepted"}
    assert json.loads(state)["submission_id"] == json.loads(again)["submission_id"]
    assert uuid.UUID(json.loads(state)["submission_id"])
    assert erased == "204"
    assert not Submission.objects.exists()


def test_every_call_is_documented_and_every_documented_call_exists() -> None:
    table = DOCUMENT.split("## Calls")[1].split("\n\n")[0]
    paths = {
        re.sub(r"\{[a-z_]+\}", "{}", path.split("?")[0])
        for cell in re.findall(r"^\| (`.*?`) \|", table, re.M)
        for path in re.findall(r"(/[^`,\s]*)", cell)
    }
    described = {
        re.sub(r"\{[a-z_]+\}", "{}", path.removeprefix("/api/v1")).replace("{}-{}", "{}")
        for path in document()["paths"]
    }

    assert paths == described


def test_the_limits_are_the_settings_defaults(settings: Any) -> None:
    documented = re.findall(r"\| ([0-9]+) an? (?:minute|hour) \| `FRONTRUNNER_LIMITS` \|", DOCUMENT)

    names = ("SUBMISSIONS_PER_MINUTE", "OWN_REQUESTS_PER_MINUTE", "ENROLMENTS_PER_HOUR", "ATTEMPTS_PER_HOUR")
    names = (*names, "READS_PER_MINUTE", "PAGES_PER_MINUTE", "RANGES_PER_MINUTE")
    assert [int(number) for number in documented] == [
        getattr(settings, f"FRONTRUNNER_{name}") for name in names
    ]


def test_the_daily_limits_are_the_settings_defaults(settings: Any) -> None:
    for name, unit in (("BYTES", 1 << 20), ("STORED_BYTES", 1 << 20), ("VALUES", 1)):
        quota = getattr(settings, f"FRONTRUNNER_{name}_PER_DAY") // unit
        size = " MiB" if unit > 1 else ""
        row = f"{quota}{size} a day for an installation"
        if name == "STORED_BYTES":
            row += (
                f", {daily_limits.ADDRESS_FACTOR * quota}{size} for an address; beyond that each installation"
            )
            row += " behind it still has an equal part"
        assert f"{row} | `FRONTRUNNER_LIMITS` |" in DOCUMENT
    assert f"opening brackets | {json_limits.MAX_VALUES} | |" in DOCUMENT
    assert f"| {json_limits.MAX_DEPTH} levels | |" in DOCUMENT
