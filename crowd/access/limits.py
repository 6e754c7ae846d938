"""Rate limits: per installation for requests with a token, otherwise per address. Addresses are not stored.

Answers report them in the fields RateLimit-Policy and RateLimit of the IETF's draft "RateLimit header fields
for HTTP" (draft-ietf-httpapi-ratelimit-headers-10): quota q in a window of w seconds, r left for t seconds.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, cast

from django.conf import settings
from django.http import HttpRequest
from rest_framework.request import Request
from rest_framework.throttling import BaseThrottle

from crowd.access import counters
from crowd.access.addresses import address_of

A_MINUTE, AN_HOUR = 60, 3600


@dataclass(frozen=True)
class Usage:
    """The state of a limit: `quota` requests are allowed in `seconds`, `used` were made."""

    name: str
    quota: int
    seconds: int
    used: int
    resets_in: float

    @property
    def exceeded(self) -> bool:
        return self.used > self.quota

    @property
    def headers(self) -> dict[str, str]:
        """The two header fields of the draft."""
        left, reset = max(self.quota - self.used, 0), math.ceil(self.resets_in)
        return {
            "RateLimit-Policy": f'"{self.name}";q={self.quota};w={self.seconds}',
            "RateLimit": f'"{self.name}";r={left};t={reset}',
        }


class Limit(BaseThrottle):
    """One limit: what it counts, its name in answers, the setting with its quota, its window in seconds."""

    what: ClassVar[str]
    name: ClassVar[str]
    setting: ClassVar[str]
    seconds: ClassVar[int]

    def __init__(self) -> None:
        self.usage: Usage | None = None

    @property
    def quota(self) -> int:
        """Requests allowed in a window; 0 means no limit."""
        return int(getattr(settings, self.setting))

    def key(self, request: Request | HttpRequest) -> str:
        """The key under which `request` is counted. It does not identify a person."""
        raise NotImplementedError

    def count(self, request: Request | HttpRequest) -> bool:
        """Count `request` and return whether it is allowed. `usage` is then what its answer reports."""
        if not (quota := self.quota):
            return True
        with counters.tolerate_failure("requests"):
            count = counters.count(f"{self.name}:{self.key(request)}", self.seconds)
            self.usage = Usage(self.name, quota, self.seconds, count.used, count.resets_in)
            return not self.usage.exceeded
        return True

    def allow_request(self, request: Request, view: Any) -> bool:
        """Called by Django REST framework. Sets `view.usage` for the answer."""
        allowed = self.count(request)
        view.usage = self.usage or view.usage
        return allowed

    def wait(self) -> float | None:
        """Seconds until the next request may be made."""
        return None if self.usage is None else max(self.usage.resets_in, 1.0)


class ByAddress(Limit):
    """Counts per client address, as a keyed hash whose key is deleted the day after."""

    def key(self, request: Request | HttpRequest) -> str:
        return counters.hmac_identifier(address_of(request))


class ByInstallation(Limit):
    """Counts per installation that the token belongs to."""

    def key(self, request: Request | HttpRequest) -> str:
        return str(cast(Request, request).auth.pk)


class Reads(ByAddress):
    """API requests without a valid token."""

    what = "other API requests of an address"
    name, setting, seconds = "reads", "FRONTRUNNER_READS_PER_MINUTE", A_MINUTE


class Pages(ByAddress):
    """Pages, and the tables, cards and exports that they link to."""

    what = "pages, tables, cards and exports read from an address"
    name, setting, seconds = "pages", "FRONTRUNNER_PAGES_PER_MINUTE", A_MINUTE


class Ranges(ByAddress):
    """Parts of files of the open data."""

    what = "ranges of open-data files read from an address"
    name, setting, seconds = "ranges", "FRONTRUNNER_RANGES_PER_MINUTE", A_MINUTE


class Enrolments(ByAddress):
    """New installations."""

    what = "enrolments of an address"
    name, setting, seconds = "enrolments", "FRONTRUNNER_ENROLMENTS_PER_HOUR", AN_HOUR


class Attempts(ByAddress):
    """Steps of measuring in a browser, which are counted without a token."""

    what = "counted steps of browsers of an address"
    name, setting, seconds = "attempts", "FRONTRUNNER_ATTEMPTS_PER_HOUR", AN_HOUR


class Submissions(ByInstallation):
    """Submissions and dry runs."""

    what = "submissions and dry runs of an installation"
    name, setting, seconds = "submissions", "FRONTRUNNER_SUBMISSIONS_PER_MINUTE", A_MINUTE


class OwnRequests(ByInstallation):
    """Requests of an installation about its own data."""

    what = "other requests of an installation"
    name, setting, seconds = "own", "FRONTRUNNER_OWN_REQUESTS_PER_MINUTE", A_MINUTE


def in_force() -> list[Limit]:
    """The limits that this server applies."""
    kinds = (Submissions, OwnRequests, Enrolments, Attempts, Reads, Pages, Ranges)
    return [limit for limit in (kind() for kind in kinds) if limit.quota]
