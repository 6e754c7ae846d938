"""How a page is cited: as plain text and as BibTeX, with the version of the open data and its digest."""

import hashlib
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from urllib.parse import quote, urlsplit

from crowd.dashboard.answering import kept
from crowd.results.opendata import exports
from crowd.results.opendata.description_files import DATA_PACKAGE, descriptions
from crowd.results.opendata.tables import LICENCE

SIMULATED = "Simulated, not measured"
# Digits of a digest where a reader sees it; the whole digest is in a field of its own.
SHORT = 12
# What TeX reads as a command, as BibTeX passes it on.
_TEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#",
    "_": r"\_", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
}  # fmt: skip


@dataclass(frozen=True)
class Version:
    """An export of the open data: its day, and the SHA-256 of its datapackage.json, which holds the digests
    of all its files.
    """

    day: str
    digest: str

    @property
    def words(self) -> str:
        """As a source line says it."""
        return f"open data of {self.day}, SHA-256 {self.digest[:SHORT]}"


@dataclass(frozen=True)
class Citation:
    """A page with TITLE at URL, read on DAY. `version` is None before the site's first export; `front` is the
    digest of the front that the page is about, if it is about one.
    """

    title: str
    url: str
    day: date
    version: Version | None
    simulated: bool = False
    front: str = ""

    @property
    def key(self) -> str:
        """A BibTeX key: letters, digits and hyphens, the same for the same page and year."""
        address = urlsplit(self.url)
        words = re.sub(r"[^a-z0-9]+", "-", address.path.lower()).strip("-") or "home"
        query = f"-{hashlib.sha256(address.query.encode()).hexdigest()[:4]}" if address.query else ""
        return f"frontrunner-{self.day.year}-{words}{query}"

    @property
    def note(self) -> str:
        """What else a reader needs: which data, under which licence, and when it was read."""
        parts = [
            self._data,
            f"the front's SHA-256 {self.front[:SHORT]}" if self.front else "",
            f"licence {LICENCE['name']}",
            f"accessed {self.day.isoformat()}",
        ]
        return "; ".join(filter(None, parts))

    @property
    def _data(self) -> str:
        if self.simulated:
            return f"{SIMULATED}, and in no open data"
        if self.version is None:
            return "No open data exported yet, this cites the page itself"
        return self.version.words[0].upper() + self.version.words[1:]

    @property
    def text(self) -> str:
        """The citation as one paragraph."""
        return f"Frontrunner: {self.title}. {self.day.year}. {self.url} ({self.note}.)"

    @property
    def bibtex(self) -> str:
        """The citation as an entry of a .bib file."""
        fields = {
            "author": "{Frontrunner}",
            "title": f"{{{tex(self.title)}}}",
            "year": str(self.day.year),
            "url": verbatim(self.url),
            "urldate": self.day.isoformat(),
            "note": tex(self.note),
        }
        if self.version and not self.simulated:
            fields |= {"version": self.version.day, "sha256": self.version.digest}
        return _entry(self.key, fields)


def newest_version() -> Version | None:
    """The newest export, as of a minute ago; None before the first. Pages ask for it without a query."""
    words = kept("newest export", _newest).decode().split()
    return Version(*words) if words else None


def _newest() -> bytes:
    export = exports.published_exports().first()
    if export is None:
        return b""
    digest = hashlib.sha256(descriptions(export)[DATA_PACKAGE]).hexdigest()
    return f"{export.name} {digest}".encode()


def source(url: str, day: date, version: Version | None, simulated: bool, notice: str) -> tuple[str, ...]:
    """What the last line of a saved figure says: where it is from, when it was drawn, from which data."""
    drawn = f"Drawn on {day.isoformat()} from live data"
    if simulated:
        return (url, SIMULATED, drawn, LICENCE["name"], notice)
    exported = f"newest {version.words}" if version else "no open data exported yet"
    return (url, f"{drawn}; {exported}", LICENCE["name"], notice)


def tex(text: str) -> str:
    """TEXT as TeX prints it literally."""
    plain = unicodedata.normalize("NFC", text).replace("\N{NARROW NO-BREAK SPACE}", " ")
    return "".join(_TEX.get(letter, letter) for letter in " ".join(plain.split()))


def verbatim(url: str) -> str:
    """URL for a field that TeX does not interpret: nothing in it ends the field."""
    return quote(url, safe=":/?#[]@!$&'()*+,;=%-._~")


def _entry(key: str, fields: Mapping[str, str]) -> str:
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@misc{{{key},", *lines, "}", ""])
