"""The measuring machine: its description, the choice of a device, and its condition."""
