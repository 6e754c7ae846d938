"""Pages by noun: each view parses, asks a selector, and renders."""
