"""Devices that execute kernels, and how kernels are laid out on each."""
