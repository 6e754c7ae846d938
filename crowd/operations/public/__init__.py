"""Checks before strangers use a server. `checks.run()` runs them; a page and a command show the results."""
