"""Communication with a server: requests, downloads, and sending each session once."""
