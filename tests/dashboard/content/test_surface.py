"""The response surface: how it is read, what is said of it, how it is drawn."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from django.test import Client

from crowd.dashboard.content.surface import Surface, chosen, read, rows, summarise
from crowd.dashboard.drawings.surface import cells_table
from crowd.dashboard.figures.palette import LIGHT
from crowd.dashboard.figures.surfaces import surface_map
from tests.dashboard.reading import one_space
from tests.dashboard.reading import read as page_text

COLUMNS = (
    "system", "frames", "round", "mu", "icp_threshold", "volume_resolution", "runtime", "ate_mean",
    "ate_max", "lost", "failure",
)  # fmt: skip
# mu across, icp_threshold along: seconds and metres. The last two rows did the same work.
RUNTIME = [[0.08, 0.04], [0.05, 0.03], [0.06, 0.03]]
ERROR = [[0.004, 0.01], [0.002, 0.06], [0.002, 0.06]]


def written(folder: Path, rounds: int = 1, **changes: str) -> Path:
    """A grid of 2 x 3 cells below `folder`, its first row with `changes`; its description.

    Each round takes a millisecond longer than the one before.
    """
    with (folder / "grid.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        rows = [
            {"system": "kfusion", "frames": 100, "round": number + 1, "mu": mu, "icp_threshold": icp,
             "volume_resolution": 256, "runtime": RUNTIME[row][column] + number * 1e-3,
             "ate_mean": ERROR[row][column] / 2,
             "ate_max": ERROR[row][column], "lost": 0, "failure": ""}
            for number in range(rounds)
            for row, icp in enumerate((1e-5, 0.1, 1.0))
            for column, mu in enumerate((0.1, 0.2))
        ]  # fmt: skip
        rows[0] |= changes
        writer.writerows(rows)
    description = folder / "grid.json"
    description.write_text(json.dumps({"x": "mu", "y": "icp_threshold", "provenance": {"device": "a PC"}}))
    return description


@pytest.fixture
def surface(tmp_path: Path) -> Surface:
    return read(written(tmp_path))


def test_a_surface_is_read_with_its_axes_and_what_stayed_the_same(surface: Surface) -> None:
    assert (surface.x_values, surface.y_values) == ((0.1, 0.2), (1e-5, 0.1, 1.0))
    assert surface.runtime.tolist() == RUNTIME
    assert surface.fixed == {"volume_resolution": "256"}
    assert surface.alike == ((1, 2),)


def test_a_grid_with_a_hole_or_of_two_settings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not a full grid"):
        read(written(tmp_path, mu="0.3"))
    with pytest.raises(ValueError, match="more than one setting"):
        read(written(tmp_path, volume_resolution="64"))


def test_rounds_give_a_mean_with_its_spread(tmp_path: Path) -> None:
    surface = read(written(tmp_path, rounds=3))

    assert (surface.rounds, surface.repeats) == (3, "3 times")
    assert surface.runtime[0] == pytest.approx([0.081, 0.041])
    assert rows(surface)[0].runtime[0] == pytest.approx((0.081, 0.001))
    assert rows(surface)[0].ate_max[0] == (0.004, 0.0)
    assert "81.0 ms ± 1.00 ms a frame" in one_space(
        surface_map(surface, "runtime", LIGHT).data[0].customdata[0][0]
    )
    summary = summarise(surface)
    assert summary.cells == 6
    # Each round slows all cells alike: next to no noise.
    assert summary.relief is not None
    assert 0 < summary.relief.noise < 0.01 < summary.relief.shape
    (first, *_) = cells_table(surface).rows
    assert first == (0.1, 1e-5, pytest.approx(0.081), pytest.approx(0.001), 0.004, 0.0, 3, True)


def test_one_round_has_no_spread(surface: Surface) -> None:
    assert rows(surface)[0].runtime == ((0.08, None), (0.04, None))
    assert summarise(surface).relief is None


def test_a_cell_is_valid_if_it_was_in_every_round(tmp_path: Path) -> None:
    assert not read(written(tmp_path, rounds=2, ate_max="0.051")).valid[0, 0]


def test_a_round_with_a_hole_is_refused_with_its_number(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"the 5 cells of round 1 are not a full grid of 2 x 3: measure"):
        read(written(tmp_path, round="3"))


def test_a_cell_that_the_device_could_not_run_is_blank_and_not_valid(tmp_path: Path) -> None:
    failed = {"runtime": "", "ate_mean": "", "ate_max": "", "failure": "no memory"}

    surface = read(written(tmp_path, **failed))

    assert np.isnan(surface.runtime[0, 0])
    assert not surface.valid[0, 0]
    assert surface_map(surface, "runtime", LIGHT).data[0].z[0][0] is None


def test_what_is_said_of_a_surface_is_computed_from_it(surface: Surface) -> None:
    summary = summarise(surface)

    assert (summary.cells, summary.valid) == (6, 4)
    # Faster cells lost their way.
    assert summary.fastest is not None
    assert (summary.fastest.x, summary.fastest.y, summary.fastest.runtime) == (0.2, 1e-5, 0.04)
    assert summary.most_accurate is not None
    assert summary.most_accurate.ate_max == 0.002
    assert not summary.inside
    assert summary.runtime_across == pytest.approx(2.0)
    assert summary.ate_along == pytest.approx(6.0)
    assert summary.noise == pytest.approx((1.1, 1.2))


def test_the_map_has_a_logarithmic_scale_and_crosses_where_trajectories_are_invalid(surface: Surface) -> None:
    cells, crosses = surface_map(surface, "ate_max", LIGHT).data

    assert cells.z[0] == pytest.approx((np.log10(0.4), 0.0), abs=1e-3)
    assert "0.40" in cells.customdata[0][0]
    assert list(zip(crosses.x, crosses.y, strict=True)) == [(1, 1), (1, 2)]


def test_the_surface_that_ships_is_whole_and_says_where_it_was_measured() -> None:
    surface = chosen("")

    assert surface is not None
    assert surface.application == "kfusion"
    assert chosen("kfusion") is surface
    assert chosen("none") is None
    assert surface.runtime.size == surface.provenance["evaluations"]
    assert {"device", "driver", "date", "software", "command", "sequence_sha256"} <= surface.provenance.keys()
    assert surface.valid.all()


@pytest.mark.django_db
def test_the_page_says_what_the_surface_shows_and_where_it_was_measured(client: Client) -> None:
    page = page_text(client, "/surface/")

    assert "All 80 configurations are valid" in page
    assert "n = 80 configurations, each measured once on one device" in page
    assert "python -m slam surface --x mu --x-values 0.025,0.05," in page
    assert "pthread-haswell-AMD EPYC" in page
    assert "keeps its default, except compute size ratio: 1 instead of 2." in page
    assert "Measured; the data come with Frontrunner and are in no release of the open data" in page


@pytest.mark.django_db
def test_an_application_without_a_surface_has_no_such_page(client: Client) -> None:
    assert client.get("/surface/?application=none").status_code == 404
    assert client.get("/figures/surface/runtime.json?application=none").status_code == 404
    assert client.get("/surface/?application=kfusion").status_code == 200


@pytest.mark.django_db
def test_both_maps_have_their_numbers_beside_them(client: Client) -> None:
    figure = client.get("/figures/surface/runtime.json").json()
    rows = list(csv.DictReader(io.StringIO(client.get("/tables/surface/error.csv").content.decode())))

    assert len(figure["data"][0]["z"]) == 8
    assert len(rows) == 80
    assert float(rows[0]["ate_max_m"]) < 0.05
