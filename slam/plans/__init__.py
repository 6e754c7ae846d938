"""The plan of a frame as data, and its executors."""
