"""The settings of a search's own server: only /healthz needs no token."""

from crowd.settings import *  # noqa: F403

ROOT_URLCONF = "frontrunner.lease_urls"
ALLOWED_HOSTS = ["*"]  # hosts call it by any name; without pages and log-ins there is nothing to rebind to
