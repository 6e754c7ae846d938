"""The examples of docs/data/open-data.md run as they stand, on an export of a server that answers."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import duckdb
import pytest

from crowd.fronts.publishing.services import publish_content
from crowd.results.opendata import exports
from tests.builders.crowds import Join, crowd, send
from tests.builders.documents import front_document
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.crowd.buckets import IN_BOTH_PLACES
from tests.crowd.exported import copy

DOCS = Path(__file__).resolve().parents[3] / "docs" / "data" / "open-data.md"
SERVER = "http://127.0.0.1:8000"


def example(language: str) -> str:
    """The block of `language` in the page."""
    found = re.search(rf"^```{language}\n(.*?)^```$", DOCS.read_text(), re.DOTALL | re.MULTILINE)
    assert found, language
    return found[1]


@pytest.fixture
def server(live_server: Any, transactional_db: None, pack: dict[str, Any], join: Join) -> str:
    """A server with an export of five sessions on two devices; its address."""
    publish_content(front_document(pack))
    crowd(join, {"Pixel 8": [80 / 10, 80 / 11, 80 / 12], "Pixel 7": [80 / 13, 80 / 14]})
    leaving = join()
    send(leaving)
    exports.create_export()
    leaving.delete("/me")
    exports.create_export()
    return str(live_server.url)


@pytest.mark.slow
def test_pandas(server: str, tmp_path: Path) -> None:
    program = example("python").replace(SERVER, server).replace("kfusion-6", "kfusion-test")
    summary = json.load(urlopen(f"{server}/api/v1/speedups"))["summary"]

    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )

    assert done.returncode == 0, done.stderr
    models, headline = done.stdout.splitlines()[0].split()
    assert int(models) == summary["headline"]["models"] > 0
    assert float(headline) == pytest.approx(summary["headline"]["value"])
    assert re.search(r"google-pixel-8\s+7\.2", done.stdout), done.stdout
    assert "mean" in done.stdout


@pytest.mark.slow
def test_curl_and_duckdb(server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed")
    fetch = example("sh").replace(SERVER, server)
    subprocess.run(["sh", "-c", fetch], cwd=tmp_path, check=True, capture_output=True)
    monkeypatch.chdir(tmp_path)

    stages, devices, erased = (
        duckdb.sql(statement).fetchall() for statement in example("sql").split(";") if statement.strip()
    )

    assert stages[0] == ("best", "raycasting", 6.0)
    assert devices == [("google-pixel-8", 3, 12, 12), ("google-pixel-7", 2, 8, 8)]
    assert erased == []


@IN_BOTH_PLACES
def test_tombstones_find_what_an_earlier_copy_still_holds(
    participant: Participant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = measure(participant)
    earlier = exports.create_export()
    copy(earlier, "runs.parquet", tmp_path)
    participant.delete(f"/me/runs/{session['runs'][2]['id']}")
    later = exports.create_export()
    copy(later, "tombstones.parquet", tmp_path)
    monkeypatch.chdir(tmp_path)

    *_, erased = (part for part in example("sql").split(";") if part.strip())

    assert duckdb.sql(erased).fetchall() == [(session["runs"][2]["id"],)]
