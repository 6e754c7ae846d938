"""What other applications may want to know about erasures."""

from django.dispatch import Signal

# Measurements of `cohorts` (list of Cohort) were erased. Sent within the transaction.
measurements_erased = Signal()
