"""Objectives, dominance and the quality of a front. Needs NumPy only."""
