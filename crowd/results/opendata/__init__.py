"""The open data: all measurements as public files. How they are written, rewritten and served."""
