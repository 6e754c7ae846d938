"""Files in the data folder."""

from pathlib import Path

from django.conf import settings
from django.core.files.storage import FileSystemStorage


class Folder(FileSystemStorage):
    """The folder `name` of FRONTRUNNER_VAR."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name

    @property
    def location(self) -> str:
        """The path of the folder."""
        return str(Path(settings.FRONTRUNNER_VAR) / self._name)

    def take(self, path: Path) -> None:
        """Move the file at `path`, of the same file system, here under its name. It replaces one at once."""
        path.replace(self.path(path.name))
