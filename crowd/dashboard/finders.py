"""plotly.min.js comes out of the installed plotly wheel: no copy of it is kept in the project."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from django.contrib.staticfiles.finders import BaseFinder
from django.core.files.storage import FileSystemStorage

NAME = "plotly.min.js"
PREFIX = "plotly"


class PlotlyFinder(BaseFinder):
    """Finds plotly/plotly.min.js, and nothing else of that package."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:  # noqa: ARG002 - Django's signature
        folder = Path(str(files("plotly"))) / "package_data"
        self.storage = FileSystemStorage(location=str(folder))
        # collectstatic puts what this storage lists under the prefix.
        self.storage.prefix = PREFIX  # type: ignore[attr-defined]

    def find(self, path: str, find_all: bool = False, **kwargs: Any) -> Any:  # noqa: ARG002
        """The file's path on disk where PATH names the library, else [] (as Django asks)."""
        if path != f"{PREFIX}/{NAME}":
            return []
        found = self.storage.path(NAME)
        return [found] if find_all else found

    def list(self, ignore_patterns: Any) -> Any:  # noqa: ARG002
        """One file, for collectstatic."""
        yield NAME, self.storage
