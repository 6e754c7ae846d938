"""Signals of erasures."""

from django.dispatch import Signal

# Measurements of `cohorts` (list of Cohort) were erased. Sent within the transaction.
measurements_erased = Signal()
