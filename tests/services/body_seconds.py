"""Settings of servers that wait TEST_BODY_SECONDS for slow clients."""

import os

from crowd.settings import *  # noqa: F403

FRONTRUNNER_BODY_SECONDS = int(os.environ["TEST_BODY_SECONDS"])
FRONTRUNNER_SEND_SECONDS = 3 * FRONTRUNNER_BODY_SECONDS
