"""What a participant runs: measure this device, keep the result safe, send it once."""

APP = "client_kit"
