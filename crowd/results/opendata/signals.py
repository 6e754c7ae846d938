"""Signals of the open data."""

from django.dispatch import Signal

# Files of exports are stale. Sent after the transaction.
files_stale = Signal()
