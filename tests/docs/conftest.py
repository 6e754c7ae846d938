"""What the guide says is compared with the server."""

from tests.server import *  # noqa: F403 - its fixtures
