"""Finds plotly.min.js and htmx in installed wheels, so that the project needs no copies."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from django.contrib.staticfiles.finders import BaseFinder
from django.core.files.storage import FileSystemStorage

# By address below /static/: the package and the folder in it.
LIBRARIES = {
    "plotly/plotly.min.js": ("plotly", "package_data"),
    "htmx/htmx-2.min.js": ("django_htmx", "static/django_htmx"),
}


class LibraryFinder(BaseFinder):
    """Finds the files of LIBRARIES, and no other files of these packages."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:  # noqa: ARG002 - Django's signature
        self.storages = {address: _storage(address, *location) for address, location in LIBRARIES.items()}

    def find(self, path: str, find_all: bool = False, **kwargs: Any) -> Any:  # noqa: ARG002
        """The file of the library `path`; [] for other paths, as Django requires."""
        if path not in self.storages:
            return []
        file = self.storages[path].path(Path(path).name)
        return [file] if find_all else file

    def list(self, ignore_patterns: Any) -> Any:  # noqa: ARG002
        """The file of each library, for collectstatic."""
        for address, storage in self.storages.items():
            yield Path(address).name, storage


def _storage(address: str, package: str, folder: str) -> FileSystemStorage:
    storage = FileSystemStorage(location=str(Path(str(files(package))) / folder))
    # collectstatic puts the files of this storage under the prefix.
    storage.prefix = str(Path(address).parent)  # type: ignore[attr-defined]
    return storage
