"""Everything the crowd measured as files for everybody: what they hold, how they are written and served."""
