"""The page of a search that runs: drawn while it measures, whole, and for this machine alone."""

import urllib.error
import urllib.request
from http.client import HTTPConnection

import pytest

from pareto import Explorer, Space
from pareto.cli.live_page import LivePage, served
from pareto.errors import ScenarioError
from tests.pareto.conftest import SPACE, explore, explored_rows


def test_the_page_is_drawn_again_when_it_is_due_and_never_in_parts(toy, monkeypatch):
    now = 0.0
    explorer = Explorer(Space.from_dict(SPACE), ["error", "seconds"], method="random")
    drawn = []

    def save(explorer, path, units):
        nonlocal now
        assert path.name == "front.html.new"
        path.write_text(str(len(drawn)))
        drawn.append(now)
        now += 4.0

    monkeypatch.setattr("pareto.plot.save", save)
    page = LivePage(explorer, toy, {}, clock=lambda: now)
    page.refresh()
    assert not drawn
    for later in (29.0, 31.0, 60.0, 110.0, 116.0):
        now = later
        page.refresh()
    assert drawn == [31.0, 116.0]  # drawing took 4 s: it takes at most a twentieth of the time
    assert (toy / "front.html").read_text() == "1"


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), ValueError("odd"), MemoryError()])
def test_a_failed_picture_is_a_warning_and_the_search_goes_on(toy, capsys, monkeypatch, error):
    def save(explorer, path, units):
        raise error

    monkeypatch.setattr("pareto.plot.save", save)
    monkeypatch.setattr("pareto.cli.live_page.SECONDS", 0)
    assert len(explored_rows(toy, "--batch", "4", "--budget", "12", picture=True)) == 12
    output = capsys.readouterr()
    warning = (
        f"frontrunner: warning: {toy}/out/front.html could not be drawn: {type(error).__name__}: {error}"
    )
    assert warning in output.err
    assert "on the front: " in output.out


def test_the_page_is_drawn_before_each_batch(toy, monkeypatch):
    drawn = []
    monkeypatch.setattr(LivePage, "refresh", lambda _self: drawn.append("refresh"))
    monkeypatch.setattr(LivePage, "draw", lambda _self: drawn.append("draw"))
    assert explore(toy, "--batch", "4", "--budget", "12", picture=True) == 0
    assert drawn == ["refresh"] * 3 + ["draw"]


def test_only_the_page_and_its_tables_are_served_and_only_to_this_machine(toy):
    (toy / "front.html").write_text("<p>page</p>")
    (toy / "front.csv").write_text("a\n1\n")
    with served(toy, 0) as address:
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address) as answer:
            assert answer.read() == b"<p>page</p>"
            assert answer.headers["Refresh"]
            assert answer.headers["Cache-Control"] == "no-store"
        with urllib.request.urlopen(f"{address}front.csv") as answer:
            assert answer.read() == b"a\n1\n"
        for path in ("space.json", "evaluations.csv", "../table.csv", "%2e%2e/table.csv", "/etc/passwd"):
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(address + path)
            assert refused.value.code == 404
        connection = HTTPConnection("127.0.0.1", int(address.rsplit(":", 1)[1].strip("/")))
        for method, host, status in (
            ("GET", "localhost:80", 200),
            ("HEAD", "127.0.0.1", 200),
            ("GET", "attacker.example", 404),
            ("POST", "localhost", 501),
        ):
            connection.request(method, "/", headers={"Host": host})
            answer = connection.getresponse()
            assert (answer.status, len(answer.read()) > 0) == (status, method != "HEAD")
            connection.close()
        with (
            pytest.raises(ScenarioError, match="cannot be used"),
            served(toy, int(address.split(":")[2][:-1])),
        ):
            pass
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address)


def test_a_search_tells_where_its_page_is(toy, capsys, monkeypatch):
    monkeypatch.setattr(LivePage, "draw", lambda _self: None)
    assert explore(toy, "--budget", "3", "--serve", "0", picture=True) == 0
    assert "the progress is shown at http://127.0.0.1:" in capsys.readouterr().err
