"""Measuring a configuration: by a program, or by a lookup in a table."""
