"""Pages as their readers see them."""

import re
from html import unescape
from typing import Any

from django.test import Client

from crowd.dashboard.formats import ABSENT, RANGE, TIMES


def text(response: Any) -> str:
    """What a reader sees: no tags, any white space as one blank, the signs of formats in ASCII."""
    return words_of(response.content.decode())


def words_of(markup: str) -> str:
    """What a reader sees of `markup`."""
    body = re.sub(r"<(script|style).*?</\1>", " ", markup, flags=re.DOTALL)
    words = " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())
    return words.replace(TIMES, "x").replace(RANGE, "-").replace(ABSENT, "-")


def read(client: Client, address: str) -> str:
    """The text of the page at `address`, which is there."""
    response = client.get(address)
    assert response.status_code == 200, address
    return text(response)


def plain(client: Client, address: str) -> str:
    """The text of the page at `address`, with ordinary blanks."""
    return one_space(read(client, address))


def one_space(words: str) -> str:
    """`words` with ordinary blanks."""
    return words.replace("\N{NO-BREAK SPACE}", " ").replace("\N{NARROW NO-BREAK SPACE}", " ")
