"""What must be right before strangers use a server: `checks.lines()` looks, page and command show it."""
