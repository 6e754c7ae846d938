"""Backends never mix: a model counts once, and its page shows them side by side."""

from dataclasses import replace
from typing import Any, get_args

import pytest
from django.test import Client

from crowd.results.reading import selectors
from crowd.results.reading.backends import BACKENDS, backend_comparison
from crowd.results.reading.queries.filters import SpeedupFilters
from tests.builders.documents import (
    browser_document,
    device_document,
    run_document,
    session_document,
    submission_document,
)
from tests.builders.measuring import measure
from tests.builders.participant import API
from tests.builders.stored import join
from tests.dashboard.conftest import Filling
from tests.dashboard.reading import read, text
from wire.session import Backend

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("both")]


def in_a_browser(default_us: int = 80_000, best_us: int = 20_000, **device: Any) -> None:
    """A session over WebGPU on a Pixel 8, four times faster with best."""
    session = session_document(default_us=default_us, best_us=best_us, backend="webgpu")
    raw = browser_document(
        **{"model": "Pixel 8", "gpu_vendor": "arm", "gpu_architecture": "valhall"} | device
    )
    answer = join().submit(submission_document(session, device=raw))
    assert answer.status_code == 202, answer.content


@pytest.fixture(scope="module")
def both(session: dict[str, Any], filling: Filling) -> None:
    """A Pixel 8 natively and in a browser, a Pixel 9 in a browser alone."""
    with filling():
        in_a_browser()
        in_a_browser(model="Pixel 9")


def test_every_backend_of_a_submission_has_a_name_and_a_place() -> None:
    assert set(BACKENDS) == set(get_args(Backend))
    assert (next(iter(BACKENDS)), list(BACKENDS)[-2:]) == ("opencl", ["webgpu", "wasm"])


def test_a_model_counts_once_natively_before_in_a_browser() -> None:
    crowd = selectors.speedups(SpeedupFilters())

    assert [(row.device.name, row.backend, row.speedup) for row in crowd.rows] == [
        ("Pixel 8", "opencl", pytest.approx(8.0)),
        ("Pixel 8", "webgpu", pytest.approx(4.0)),
        ("Pixel 9", "webgpu", pytest.approx(4.0)),
    ]
    assert (crowd.headline.devices, crowd.headline.sessions) == (2, 2)
    assert crowd.headline.geometric_mean == pytest.approx((8.0 * 4.0) ** 0.5)
    assert [row.speedup.backend for row in selectors.devices() if row.speedup] == ["opencl", "webgpu"]
    place = crowd.ranking("google-pixel-8")
    assert place is not None
    assert place.speedup == pytest.approx(8.0)


def test_a_gpu_in_a_browser_counts_before_a_native_cpu() -> None:
    device = device_document("Pixel 4", opencl_platform="Portable Computing Language", opencl_device="cpu")
    assert join().submit(submission_document(device=device)).status_code == 202
    in_a_browser(model="Pixel 4")

    crowd = selectors.speedups(SpeedupFilters(device="Pixel 4"))
    assert [(row.processor_class, round(row.speedup), row.counts) for row in crowd.rows] == [
        ("cpu", 8, True),
        ("gpu", 4, True),
    ]
    assert crowd.headline.geometric_mean == pytest.approx(4.0)


def test_two_backends_on_a_device_are_compared(client: Client) -> None:
    device = client.get("/devices/google-pixel-8/").content.decode()
    address = "/compare/?device=google-pixel-8&backends=opencl,webgpu"
    page = read(client, address)

    assert f'href="{address.replace("&", "&amp;")}' in device
    assert address.removeprefix("/compare/").replace("&", "&amp;") in client.get("/compare/").content.decode()
    assert "OpenCL and WebGPU on Google Pixel 8" in page
    assert "OpenCL is faster than WebGPU by 2.00x with best so far." in page
    assert "OpenCL gains more than WebGPU by 2.00x from best over default so far." in page
    assert "independent installations of each; there are 1 and 1" in page
    assert "Times are means over all sessions that count" in page


def test_a_backend_without_a_figure_is_named(client: Client) -> None:
    response = client.get("/compare/?device=google-pixel-8&backends=opencl,wasm")

    assert response.status_code == 400
    assert "Google Pixel 8 has no figure with wasm: choose two of opencl, webgpu" in text(response)


def test_each_backend_has_a_mean_of_its_own(client: Client) -> None:
    rows = selectors.speedups(SpeedupFilters()).breakdowns["backend"]

    means = {row.group: (row.figure.devices, row.figure.geometric_mean) for row in rows}
    assert means == {"webgpu": (2, pytest.approx(4.0)), "opencl": (1, pytest.approx(8.0))}
    page = client.get("/devices/").content.decode()
    assert '<a href="/devices/?backend=webgpu">WebGPU</a>' in page


@pytest.mark.parametrize(("asked", "speedup"), [("webgpu", 4.0), ("OpenCL", 8.0)])
def test_one_backend_can_be_asked_for(client: Client, asked: str, speedup: float) -> None:
    answer = client.get(f"{API}/speedups", {"backend": asked}).json()

    assert {row["backend"] for row in answer["results"]} == {asked.casefold()}
    assert answer["summary"]["geometric_mean"] == pytest.approx(speedup)
    page = client.get(f"/devices/?backend={asked}")
    assert f"{speedup:.2f}x" in text(page)
    assert f'<option value="{asked.casefold()}" selected>' in page.content.decode()


def test_a_backend_that_nobody_measures_with_is_refused(client: Client) -> None:
    answer = client.get(f"{API}/speedups", {"backend": "directx"})

    assert (answer.status_code, answer.json()["field"]) == (400, "backend")
    assert "opencl, cuda, metal, vulkan, cpu, webgpu, wasm" in answer.json()["detail"]


def test_a_page_shows_the_backends_of_a_device_side_by_side_and_leads_with_the_one_that_counts(
    client: Client,
) -> None:
    """The newest session is of the browser."""
    page, other = read(client, "/devices/google-pixel-8/"), read(client, "/devices/google-pixel-9/")

    assert "The same device with each backend" in page
    assert "OpenCL 80.0 ms 10.0 ms 8.00x - 1 Mali-G715" in page
    assert "WebGPU 80.0 ms 20.0 ms 4.00x - 1 Mali (Valhall)" in page
    assert "The same device with each backend" not in other
    assert "Speedup of best over default 8.00x" in page
    assert "A frame of best 10.0 ms 100 fps, 8.00x faster in that session" in page
    assert "This page leads with OpenCL." in page
    assert "Speedup of best over default 4.00x" in other


def test_times_on_a_page_are_those_whose_quotient_is_the_speedup_of_the_session(
    client: Client, django_assert_max_num_queries: Any
) -> None:
    """Repeats differ: the quotient of arithmetic means would be another one."""
    runs = [
        run_document("default", 0, 0, 80_000),
        run_document("best", 0, 1, 10_000),
        run_document("best", 1, 2, 11_000),
        run_document("default", 1, 3, 90_000),
    ]
    measure(join(), "Pixel 4", runs=runs)
    detail = selectors.device("google-pixel-4")
    assert detail is not None
    assert detail.latest is not None
    (figure,) = detail.speedups
    answer = detail.latest.session.speedup()
    assert answer is not None

    with django_assert_max_num_queries(0):
        shown = selectors.newest_times(detail, figure)
    asked = selectors.newest_times(replace(detail, latest=None), figure)

    assert shown is not None
    assert asked is not None
    assert shown.speedup == pytest.approx(answer.speedup, rel=1e-9)
    assert (asked.session, asked.default) == (shown.session, pytest.approx(shown.default))
    assert (shown.default, shown.best) == pytest.approx((0.0848528, 0.0104881), rel=1e-5)
    page = read(client, "/devices/google-pixel-4/")
    assert "A frame of default 84.9 ms" in page
    assert "A frame of best 10.5 ms" in page


def test_the_comparison_of_backends_costs_so_many_queries(django_assert_max_num_queries: Any) -> None:
    detail = selectors.device("google-pixel-8")
    assert detail is not None

    with django_assert_max_num_queries(6):
        assert len(backend_comparison("google-pixel-8", detail.speedups, "kfusion-test")) == 2
    with django_assert_max_num_queries(0):
        assert backend_comparison("google-pixel-9", (), "kfusion-test") == ()


def test_what_is_plausible_is_said_by_the_same_backend() -> None:
    """Confirmed 15 times over OpenCL makes 50 plausible there, and not in a browser."""
    for _ in range(2):
        measure(join(), "Pixel 5", default_us=60_000, best_us=4_000)
    measure(join(), "Pixel 4", default_us=50_000, best_us=1_000)
    in_a_browser(default_us=50_000, best_us=1_000, model="Pixel 4")

    rows = {row.backend: row for row in selectors.speedups(SpeedupFilters(device="Pixel 4")).rows}

    assert (rows["opencl"].suspect, rows["webgpu"].suspect) == (False, True)
