"""Files that hold sequences: a reader for each, and writers for some."""
