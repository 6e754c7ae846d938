"""The participant's client: measure this device, store the result safely, send it once."""

APP = "client_kit"
