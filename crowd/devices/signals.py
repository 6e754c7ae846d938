"""What the other rooms may want to know of devices."""

from django.dispatch import Signal

# Models whose sessions no longer stand under what the public sees; `keys` are their primary keys. Sent after
# the transaction; the rows are marked `changed` too, for whom the signal does not reach.
models_changed = Signal()
