"""Citations of pages as plain text and BibTeX, with the version of the open data and its digest."""

import hashlib
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from urllib.parse import quote, urlsplit

from crowd.dashboard.responses import cached
from crowd.demo.mark import is_demo
from crowd.results.models import Export
from crowd.results.opendata.description_files import DATA_PACKAGE
from crowd.results.opendata.releases import releases
from crowd.results.opendata.tables import LICENCE

SIMULATED = "Simulated, not measured"
# Where the data of a page are: in releases of the open data, on this server only, or shipped with Frontrunner
# (measured, also on a demo server).
RELEASED, UNRELEASED, SHIPPED = "released", "unreleased", "shipped"
# Digits of a digest in the text; the BibTeX field `sha256` has all of them.
SHORT = 12
# Characters with a meaning in TeX, and their replacements.
_TEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#",
    "_": r"\_", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
}  # fmt: skip


@dataclass(frozen=True)
class Version:
    """A release of the open data: its day, and the SHA-256 of its datapackage.json.

    datapackage.json holds the digests of all files.
    """

    day: str
    digest: str

    @property
    def words(self) -> str:
        """The version in words, for a source line."""
        return f"release {self.day} of the open data, SHA-256 {self.digest[:SHORT]}"


@dataclass(frozen=True)
class Citation:
    """The citation of a page with `title` at URL, read on `day`.

    `version` is None before the first release, and for data that are not RELEASED. `front` is the digest of
    the front on the page, or "".
    """

    title: str
    url: str
    day: date
    version: Version | None
    front: str = ""
    origin: str = RELEASED

    @property
    def key(self) -> str:
        """The BibTeX key: letters, digits and hyphens, stable for a page and year."""
        address = urlsplit(self.url)
        words = re.sub(r"[^a-z0-9]+", "-", address.path.lower()).strip("-") or "home"
        query = f"-{hashlib.sha256(address.query.encode()).hexdigest()[:4]}" if address.query else ""
        return f"frontrunner-{self.day.year}-{words}{query}"

    @property
    def note(self) -> str:
        """Further facts: the data, the licence and the date of access."""
        parts = [
            self._data,
            f"the front's SHA-256 {self.front[:SHORT]}" if self.front else "",
            f"licence {LICENCE['name']}",
            f"accessed {self.day.isoformat()}",
        ]
        return "; ".join(filter(None, parts))

    @property
    def _data(self) -> str:
        if self.origin == SHIPPED:
            return "Measured; the data come with Frontrunner and are in no release of the open data"
        missing = (
            "no release of the open data yet" if self.origin == RELEASED else "in no release of the open data"
        )
        words = self.version.words if self.version else f"{missing}, this cites the page itself"
        return f"{SIMULATED}; {words}" if is_demo() else words[0].upper() + words[1:]

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
        if self.version:
            fields |= {"version": self.version.day, "sha256": self.version.digest}
        return _entry(self.key, fields)


def newest_version() -> Version | None:
    """The newest release, cached for a minute; None before the first."""
    words = cached("newest release", _newest).decode().split()
    return Version(*words) if words else None


def _newest() -> bytes:
    release = releases().first()
    return b"" if release is None else f"{release.name} {version_of(release).digest}".encode()


def version_of(release: Export) -> Version:
    """`release` with its digest."""
    return Version(release.name, release.files.get(name=DATA_PACKAGE).stored.sha256)


def source(
    url: str, day: date, version: Version | None, notice: str, origin: str = RELEASED
) -> tuple[str, ...]:
    """The parts of the source line of a saved figure: address, date and data."""
    drawn = f"Drawn on {day.isoformat()} from "
    if origin == SHIPPED:
        return url, f"{drawn}data that come with Frontrunner", LICENCE["name"], notice
    drawn += "live data"
    if origin == RELEASED:
        drawn += f"; newest {version.words}" if version else "; no release of the open data yet"
    return (url, *([SIMULATED] if is_demo() else []), drawn, LICENCE["name"], notice)


def tex(text: str) -> str:
    """`text` escaped for TeX."""
    plain = unicodedata.normalize("NFC", text).replace("\N{NARROW NO-BREAK SPACE}", " ")
    return "".join(_TEX.get(letter, letter) for letter in " ".join(plain.split()))


def verbatim(url: str) -> str:
    """URL escaped for a verbatim field of BibTeX."""
    return quote(url, safe=":/?#[]@!$&'()*+,;=%-._~")


def _entry(key: str, fields: Mapping[str, str]) -> str:
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@misc{{{key},", *lines, "}", ""])
