"""What a front of protocol 2 adds to its configurations: reference trajectories, bands and times."""
