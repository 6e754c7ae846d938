"""The map of surfels: fused, cleaned, and drawn as a camera would see it."""
