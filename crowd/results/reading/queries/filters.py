"""The filters of speedups, the same in all addresses of pages and API."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from datetime import date
from typing import Any, Self
from urllib.parse import urlencode
from uuid import UUID

from crowd.demo.mark import is_demo
from crowd.devices.naming.chips import VENDORS, find_vendor
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.results.reading.backends import BACKENDS
from wire.front import BEST

ALL = "all"
WHOLE_NUMBER = re.compile(r"[0-9]{1,7}")
MAX_NUMBER = 1_000_000
MAX_TEXT = 200  # characters; stored texts of devices are shorter
MAX_WORDS = 8  # of `device`; each is searched for in several columns
QUOTE = '"'


class InvalidFilterError(ValueError):
    """An invalid filter. `name` is the parameter, the message says what would be right."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


def _day(name: str, given: str) -> date:
    try:
        return date.fromisoformat(given)
    except ValueError:
        raise InvalidFilterError(name, f"{name}={given:.50}: give a day as 2026-11-30") from None


def _number(name: str, given: str) -> int:
    if not WHOLE_NUMBER.fullmatch(given) or not 1 <= int(given) <= MAX_NUMBER:
        raise InvalidFilterError(name, f"{name}={given:.50}: give a whole number from 1 to {MAX_NUMBER}")
    return int(given)


def _switch(name: str, given: str) -> bool:
    if given not in ("0", "1"):
        raise InvalidFilterError(name, f"{name}={given:.50}: give 1 for yes or 0 for no")
    return given == "1"


def _vendor(name: str, given: str) -> str:
    vendor = find_vendor(given)
    if vendor is None:
        raise InvalidFilterError(name, f"{name}={given:.50}: give one of {', '.join(VENDORS)}")
    return vendor


def _backend(name: str, given: str) -> str:
    if given.casefold() not in BACKENDS:
        raise InvalidFilterError(name, f"{name}={given:.50}: give one of {', '.join(BACKENDS)}")
    return given.casefold()


def _text(name: str, given: str) -> str:
    if len(given) > MAX_TEXT:
        raise InvalidFilterError(name, f"{name}={given:.50}...: give at most {MAX_TEXT} characters")
    return given


def _few_words(name: str, given: str) -> str:
    if len(set(_text(name, given).split())) > MAX_WORDS:
        raise InvalidFilterError(name, f"{name}={given:.50}: give at most {MAX_WORDS} different words")
    return given


def _uuid(name: str, given: str) -> UUID:
    try:
        return UUID(given)
    except ValueError:
        raise InvalidFilterError(name, f"{name}={given:.50}: give the id of a session") from None


READERS: dict[str, Callable[[str, str], Any]] = {
    "device": _few_words,
    "vendor": _vendor,
    "backend": _backend,
    "since": _day,
    "until": _day,
    "min_sessions": _number,
    "suspect": _switch,
    "simulated": _switch,
    "valid": _switch,
    "confirmed": _switch,
    "session": _uuid,
}


@dataclass(frozen=True)
class Filters:
    """Filters of figures, sessions and runs. An empty text and None do not restrict.

    soc, gpu and os match as substrings, without regard to case; in quotation marks they match exactly. Each
    word of `device` must occur in maker or name. They only use public data.
    """

    front: str = ""  # slug
    application: str = ""
    configuration: str = ""
    device: str = ""
    vendor: str = ""  # one of crowd.devices.naming.chips.VENDORS: whose chip computed
    soc: str = ""
    gpu: str = ""
    os: str = ""
    backend: str = ""  # one of BACKENDS
    since: date | None = None  # only sessions measured on or after that day (UTC)
    until: date | None = None  # only sessions measured on or before that day (UTC)
    simulated: bool | None = None  # whether on devices of a demo server

    @classmethod
    def names(cls) -> list[str]:
        """The names of the filters in the order of addresses, in which `simulated` is the last."""
        return sorted((one.name for one in fields(cls)), key=lambda name: name == "simulated")

    @classmethod
    def parse(cls, query: Mapping[str, str]) -> Self:
        """The filters of `query`; absent and empty ones have defaults. Raises InvalidFilterError."""
        return cls(**read_filters(cls.names(), query))

    @property
    def apply_here(self) -> bool:
        """Whether they can match a row of this server."""
        return self.simulated in (None, is_demo())


@dataclass(frozen=True)
class RelaxedFilters:
    """Filters with one of them removed, and a description of the removed one."""

    filters: "SpeedupFilters"
    words: str


@dataclass(frozen=True)
class SpeedupFilters(Filters):
    """Filters of figures. Without a front: the newest measured one."""

    application: str = DEFAULT_APPLICATION
    configuration: str = BEST  # ALL for every configuration
    min_sessions: int = 1
    suspect: bool = True  # include figures from suspect sessions only; the headline never does

    @property
    def period(self) -> bool:
        """Whether the days of sessions are restricted."""
        return self.since is not None or self.until is not None

    @property
    def headline_configuration(self) -> str:
        """The configuration of the headline: `best` if all are shown."""
        return BEST if self.configuration == ALL else self.configuration

    def query(self) -> str:
        """The shortest query string of these filters, in a fixed order; "" for the defaults."""
        values = {name: getattr(self, name) for name in self.names()}
        changed = {name: value for name, value in values.items() if value != getattr(SpeedupFilters, name)}
        return urlencode({name: int(v) if isinstance(v, bool) else v for name, v in changed.items()})

    def relaxed(self) -> list[RelaxedFilters]:
        """These filters, each time with one restriction removed. Both ends of a period are one restriction.

        `application` is never removed.
        """
        single = [(name,) for name in self.names() if name not in {"application", "since", "until"}]
        relaxed = []
        for names in [*single, ("since", "until")]:
            filters = replace(self, **{name: getattr(SpeedupFilters, name) for name in names})
            if filters != self:
                alone = {name: getattr(self, name) for name in names}
                relaxed.append(RelaxedFilters(filters, SpeedupFilters(**alone).describe()))
        return relaxed

    def describe(self) -> str:
        """A description, such as "Adreno, Android, since 2026-10-01"; "" without restrictions."""
        return ", ".join(filter(None, self._words()))

    def _words(self) -> list[str]:
        return [
            {True: "simulated devices", False: "real devices", None: ""}[self.simulated],
            self.application if self.application != DEFAULT_APPLICATION else "",
            self.front,
            "" if self.configuration == BEST else _configurations(self.configuration),
            f"device “{self.device}”" if self.device else "",
            VENDORS[self.vendor] if self.vendor else "",
            _matched("SoC", self.soc),
            _matched("GPU", self.gpu),
            _matched("system", self.os),
            BACKENDS.get(self.backend, ""),
            _period(self.since, self.until),
            f"at least {self.min_sessions} sessions" if self.min_sessions > 1 else "",
            "" if self.suspect else "without suspect figures",
        ]


def read_filters(names: Iterable[str], query: Mapping[str, str]) -> dict[str, Any]:
    """The values of the filters `names` in `query`, if not empty. Raises InvalidFilterError."""
    given = {name: query[name].strip() for name in names if query.get(name, "").strip()}
    values = {name: READERS.get(name, _text)(name, text) for name, text in given.items()}
    since, until = values.get("since"), values.get("until")
    if since and until and until < since:
        raise InvalidFilterError("until", f"until={until} is before since={since}: give a later day")
    return values


def exact_text(text: str) -> str | None:
    """The text between the quotation marks of `text`, to be matched exactly; None without marks."""
    marked = len(text) > 1 and text.startswith(QUOTE) and text.endswith(QUOTE)
    return text[1:-1] if marked else None


def exact_filter(text: str) -> str:
    """The filter that matches `text` exactly."""
    return f"{QUOTE}{text}{QUOTE}"


def _matched(noun: str, given: str) -> str:
    if not given:
        return ""
    exact = exact_text(given)
    return f"{noun} unknown" if exact == "" else f"{noun} “{exact or given}”"


def _configurations(name: str) -> str:
    return "every configuration" if name == ALL else f"configuration {name}"


def _period(since: date | None, until: date | None) -> str:
    if since and until:
        return f"on {since}" if since == until else f"{since} to {until}"
    return f"since {since}" if since else f"until {until}" if until else ""
