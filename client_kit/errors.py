"""The errors that stop a client, each with its exit code for scripts."""


class ClientError(Exception):
    """A reason to stop, with a message for participants; `exit_code` is that of the process."""

    exit_code = 3


class UsageError(ClientError):
    """The command line is wrong."""

    exit_code = 2


class CannotMeasureError(ClientError):
    """This device, or its current state, does not allow measuring."""


class HomeError(ClientError):
    """The folder with the client's state cannot be used."""


class OutdatedError(ClientError):
    """The server no longer accepts this version of the client."""

    exit_code = 4
