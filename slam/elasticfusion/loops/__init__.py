"""Loops: which earlier view looks like this one, and the deformation that closes the loop."""
