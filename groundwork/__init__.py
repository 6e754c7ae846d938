"""What every command stands on: the version, where files lie, the command line, the terminal."""

__version__ = "0.2.0"
