"""What `frontrunner admin prepare` makes before a web server can answer: tables and static files."""

from django.contrib.staticfiles.storage import staticfiles_storage
from django.db import connection

from crowd.database.upgrade import is_behind


def find_unprepared() -> str:
    """What is missing, with the remedy; empty if nothing is. Raises django.db.Error without a database."""
    if is_behind(connection):
        return "tables of this version are missing in the database: run frontrunner admin prepare"
    # A process reads the names of the static files when it starts.
    if not getattr(staticfiles_storage, "hashed_files", True):
        return "this machine has no static files: run frontrunner admin prepare here, then restart its server"
    return ""
