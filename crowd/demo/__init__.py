"""A demo server: all of its data is simulated, and it says so wherever data appears."""
