"""Sequences of synthetic rooms, made from a seed, with exact truth."""
