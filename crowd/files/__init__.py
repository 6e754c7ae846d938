"""Where files lie: in a folder of this machine, or in a bucket that all machines share."""


class UnavailableError(OSError):
    """A bucket does not answer, or refuses a request; the message says which and why."""
