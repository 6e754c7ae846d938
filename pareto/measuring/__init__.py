"""How a configuration is measured: by a program, or by a look at a table."""
