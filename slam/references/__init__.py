"""What protocol 2 adds to a front's configurations: reference trajectories, bands and times."""
