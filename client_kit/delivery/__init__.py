"""Between this client and a server: what is asked for, what is downloaded, what is sent, once."""
