"""Public sequences: a catalogue, and how they come to this disk."""
