"""A deployment of the first version, filled, becomes one of this version: nothing is lost, and it goes on."""

import json
from pathlib import Path

import pytest

from tests.crowd.documents import front_document, session_document, submission_document
from tests.services import former, intake
from tests.services.intake import LIMITS
from tests.services.postgresql import PostgreSQL
from tests.services.program import until
from tests.services.serving import Serving, commands, shell


@pytest.fixture(params=["sqlite", "postgresql"])
def services(request: pytest.FixtureRequest) -> dict[str, str]:
    """Environment of each database, without tables."""
    if request.param == "sqlite":
        return LIMITS
    postgresql: PostgreSQL = request.getfixturevalue("postgresql")
    postgresql.empty()
    return LIMITS | {"DATABASE_URL": postgresql.url}


def test_a_filled_database_of_the_first_version_is_brought_up_to_date(
    tmp_path: Path, services: dict[str, str]
) -> None:
    var = tmp_path / "var"
    script = f"from tests.services import former; former.make({str(var)!r})"
    ids = sorted(json.loads(shell(var, script, **services)))

    with Serving(var, services) as server:
        assert until(lambda: server.waiting() == 0)
        assert intake.own_runs(server, former.TOKEN) == ids
        _, data = server.call("GET", "/api/v1/me/data", Authorization=f"Bearer {former.TOKEN}")
        frames = {tuple(run["frame_us"]) for session in data["sessions"] for run in session["runs"]}
        assert frames == {(former.DEFAULT_US,) * 100, (former.BEST_US,) * 100}
        _, answer = server.call("GET", "/api/v1/speedups")
        (row,) = answer["results"]
        assert row["speedup"] == pytest.approx(former.DEFAULT_US / former.BEST_US)
        assert (row["sessions"], row["installations"]) == (former.SESSIONS, 1)
        _, explorations = server.call("GET", "/api/v1/explorations")
        assert [each["state"] for each in explorations["results"] if each["measured_elsewhere"] is None] == [
            "cancelled"
        ]

        assert "holds fronts of an earlier protocol: kfusion-test." in server.said()
        assert "kfusion-test" in intake.text_of(server, "/fronts/kfusion-test/")

        path = var / "front.json"
        path.write_text(
            json.dumps(front_document(json.loads(next(var.glob("*/*/pack.json")).read_text()), "next"))
        )
        commands(var, f"front publish {path} --yes", **services)
        session = session_document("kfusion-next")
        assert server.submit_until_accepted(former.TOKEN, submission_document(session)) == 202
        assert until(lambda: server.waiting() == 0)
        _, answer = server.call("GET", "/api/v1/speedups?front=kfusion-next")
        assert answer["results"][0]["sessions"] == 1
