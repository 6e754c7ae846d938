"""The commands of `python -m slam`, one a module."""
