"""What a participant runs: measure this device, keep the result safe, send it once."""

__version__ = "0.2.0"

APP = "client_kit"
