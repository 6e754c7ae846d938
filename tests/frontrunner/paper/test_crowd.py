"""The bars come from a server's API, page by page."""

from collections.abc import Iterator

import pytest

from frontrunner.paper.crowd import CrowdError, read_crowd
from frontrunner.paper.figures import bars
from frontrunner.paper.findings import Results, Verdict, findings
from tests.client_kit.scripted import Reply, ScriptedServer


def row(device, speedup, state="confirmed", simulated=False):
    return {
        "device": device, "manufacturer": "", "name": device.title(), "backend": "opencl", "processor": "CPU",
        "speedup": speedup, "low": 0.9 * speedup, "high": None, "state": state, "simulated": simulated,
    }  # fmt: skip


FIRST = "/api/v1/speedups?suspect=0&limit=1000"


@pytest.fixture
def server() -> Iterator[ScriptedServer]:
    serving = ScriptedServer(lambda _: Reply(404))
    yield serving
    serving.close()


def read(server, *pages):
    addresses = [FIRST, *(f"/api/v1/speedups?cursor={number}" for number in range(1, len(pages)))]
    replies = {
        address: Reply(200, {"front": "kfusion-6", "results": results, "next": following})
        for address, results, following in zip(addresses, pages, [*addresses[1:], None], strict=True)
    }
    server.answer = lambda request: replies.get(request.path, Reply(404))
    return read_crowd(f"{server.url}/")


def verdict(crowd):
    [finding] = [item for item in findings(Results(crowd=crowd)) if item.figure == "speedups of the crowd"]
    return finding


def test_all_pages_are_read_and_each_row_is_a_bar(server):
    crowd = read(server, [row("odroid", 12.5)], [row("pixel", 8.0, "unconfirmed"), row("pixel", 3.0)])
    assert [bar.speedup for bar in crowd.bars] == [12.5, 8.0, 3.0]
    assert crowd.devices == 2
    figure = bars(crowd)
    assert [list(trace.y) for trace in figure.data] == [[0, 2], [1]]  # one label, two bars
    assert list(figure.layout.yaxis.ticktext) == ["Odroid (opencl, CPU)", *["Pixel (opencl, CPU)"] * 2]


def test_few_devices_cannot_answer_and_many_can(server):
    assert verdict(read(server, [row("odroid", 12.5)])).verdict is Verdict.TOO_FEW
    many = [row(f"phone-{number}", 2 + number / 8) for number in range(83)]
    assert verdict(read(server, many)).verdict is Verdict.REPRODUCED
    assert verdict(read(server, [row("slow", 1.5), *many])).verdict is Verdict.DIFFERENT


def test_simulated_devices_answer_nothing(server):
    finding = verdict(read(server, [row("odroid", 12.5, simulated=True)]))
    assert finding.verdict is Verdict.NOT_HERE
    assert "simulated" in finding.here


def test_without_a_server_the_figure_says_so():
    assert verdict(None).here == "no server was given (--server URL)"


@pytest.mark.parametrize("address", ["127.0.0.1:1", "ftp://example.org", "http://127.0.0.1:1"])
def test_an_address_without_a_server_is_named(address):
    with pytest.raises(CrowdError, match=f"--server {address} does not answer like a server"):
        read_crowd(address)


def test_another_program_is_not_taken_for_a_server(server):
    server.answer = lambda _: Reply(200, {"hello": "world"})
    with pytest.raises(CrowdError, match="does not answer like a server"):
        read_crowd(server.url)
