"""What is sure of a surface measured in rounds: its shape apart from its noise."""

import numpy as np
import pytest

from slam.reports.relief import Relief
from slam.reports.surface import Grid

GRID = Grid("mu", "icp_threshold", (1.0, 2.0, 3.0, 4.0, 5.0), (1.0, 2.0, 3.0))
FLAT = np.full((3, 5), 0.02)
BOWL = 0.02 + 0.001 * (np.array(GRID.x_values) - 3) ** 2 + 0.001 * (np.array(GRID.y_values) - 2)[:, None] ** 2
RIDGE = 0.02 + 0.01 * np.array([0.1, 1.0, 2.0, 1.0, 0.0]) + np.zeros((3, 1))


def rounds(times, noise=0.0, number=5, seed=3):
    """`times` measured in rounds, of which each is slower than the one before as a whole."""
    rng = np.random.default_rng(seed)
    drift = np.linspace(1.0, 1.3, number)[:, None, None]
    return times * drift * np.exp(noise * rng.standard_normal((number, *times.shape)))


def test_a_flat_surface_is_all_noise():
    relief = Relief.of(GRID, rounds(FLAT, noise=0.05))
    assert relief.noise == pytest.approx(0.05, rel=0.3)
    assert relief.shape < 0.03
    assert len(relief.minima) == 1
    assert relief.bends == 0


def test_a_drift_of_whole_rounds_is_neither_noise_nor_shape():
    relief = Relief.of(GRID, rounds(FLAT))
    assert relief.noise == pytest.approx(0.0, abs=1e-9)
    assert relief.shape == pytest.approx(0.0, abs=1e-9)


def test_a_convex_bowl_has_one_minimum_and_no_bend():
    relief = Relief.of(GRID, rounds(BOWL, noise=0.001))
    assert relief.minima == ((1, 2),)
    assert relief.bends == 0
    assert relief.triples == 3 * 3 + 5
    assert relief.shape > 10 * relief.noise


def test_a_ridge_parts_two_minima_and_bends_downwards():
    relief = Relief.of(GRID, rounds(RIDGE, noise=0.001))
    assert {column for _, column in relief.minima} == {0, 4}
    assert relief.bends >= 3
    assert "2 separate minima" in relief.describe()


def test_two_minima_within_noise_are_one():
    relief = Relief.of(GRID, rounds(RIDGE, noise=0.8))
    assert len(relief.minima) == 1
    assert relief.blurred
    assert not Relief.of(GRID, rounds(RIDGE, noise=0.001)).blurred


def test_a_cell_that_could_not_run_takes_no_part():
    times = rounds(RIDGE, noise=0.001)
    times[:, 1, 2] = np.nan
    relief = Relief.of(GRID, times)
    assert {column for _, column in relief.minima} == {0, 4}
    assert relief.triples == 3 * 3 + 5 - 4
