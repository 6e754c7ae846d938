"""The machine that measures: what it is, which of its devices measures, and what state it is in."""
