"""A simulated crowd: plausible devices, whose labelled sessions are sent through the real API."""
