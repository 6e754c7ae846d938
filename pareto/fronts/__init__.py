"""Objectives, dominance and the quality of a front. NumPy is all they need."""
