"""Signals of devices."""

from django.dispatch import Signal

# Sent after the transaction when sessions have to follow their models; `keys` are primary keys of the models.
# The rows are also marked `changed`, in case the signal is lost.
models_changed = Signal()
