"""Camera trajectories: files, alignment, and errors by the conventions of the field."""
