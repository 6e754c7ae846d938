"""What can stop a client, each with the exit code that tells a script what happened."""


class ClientError(Exception):
    """A reason to stop that a participant can read; `exit_code` is what the process ends with."""

    exit_code = 3


class UsageError(ClientError):
    """The command line asks for something that does not exist."""

    exit_code = 2


class CannotMeasureError(ClientError):
    """This device, or its present state, allows no measurement."""


class HomeError(ClientError):
    """The folder with the client's state cannot be used."""


class OutdatedError(ClientError):
    """The server no longer accepts this version of the client."""

    exit_code = 4
