"""A person who uses the administration of a served instance: cookies, forms and their tokens."""

import re
import urllib.parse
import urllib.request
from http.cookiejar import CookieJar

from tests.services.serving import Serving

TOKEN = re.compile(r'name="csrfmiddlewaretoken" value="([^"]+)"')


class Browser:
    """Keeps cookies between its requests to `server`."""

    def __init__(self, server: Serving) -> None:
        self._url = server.url
        self._opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))

    def get(self, path: str) -> str:
        """The page at `path`."""
        with self._opener.open(f"{self._url}{path}", timeout=60) as answer:
            return str(answer.read().decode())

    def post(self, path: str, **fields: str) -> str:
        """What the form at `path` answers for `fields`, after redirects."""
        token = TOKEN.search(self.get(path))
        assert token is not None
        form = urllib.parse.urlencode(fields | {"csrfmiddlewaretoken": token[1]}).encode()
        with self._opener.open(f"{self._url}{path}", form, timeout=60) as answer:
            return str(answer.read().decode())

    def log_in(self, username: str, password: str) -> None:
        """Open the administration."""
        page = self.post("/admin/login/?next=/admin/", username=username, password=password)
        assert "Log out" in page
