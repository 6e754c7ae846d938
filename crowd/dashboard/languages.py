"""The languages of the participants' pages. Everything else is in English, which is the key of each sentence.

The catalogues are gettext's: `locale/LANGUAGE/LC_MESSAGES/django.po`, for templates, views and the browser's
modules alike.
"""

import json
import re
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar

from django.conf import settings
from django.http import HttpRequest, HttpResponseBase
from django.utils import translation
from django.utils.cache import patch_vary_headers
from django.utils.translation import gettext, ngettext

from crowd.predictions.probe_assignment import TEACHES

COOKIE_SECONDS = 365 * 24 * 3600
STRING = r'"(?:[^"\\]|\\.)*"'
# A call in a module: strings are written as in JSON.
CALL = re.compile(rf"\b(n?)gettext\(\s*({STRING})(?:,\s*({STRING}))?")

View = TypeVar("View", bound=Callable[..., HttpResponseBase])


def translated(view: View) -> View:
    """A view in the language that its visitor chose with `?language=`, else of the browser.

    The choice is kept in a cookie.
    """

    @wraps(view)
    def answered(request: HttpRequest, *args: Any, **kwargs: Any) -> HttpResponseBase:
        chosen = _chosen(request)
        language = chosen or translation.get_language_from_request(request)
        with translation.override(language):
            response = view(request, *args, **kwargs)
        response["Content-Language"] = language.partition("-")[0]
        patch_vary_headers(response, ["Accept-Language", "Cookie"])
        if chosen:
            response.set_cookie(
                settings.LANGUAGE_COOKIE_NAME,
                chosen,
                max_age=COOKIE_SECONDS,
                secure=settings.LANGUAGE_COOKIE_SECURE,
                httponly=True,
                samesite="Lax",
            )
        return response

    return answered  # type: ignore[return-value]


def _chosen(request: HttpRequest) -> str | None:
    try:
        return translation.get_supported_language_variant(request.GET.get("language", ""))
    except LookupError:
        return None


def module_translations() -> dict[str, str | list[str]]:
    """The modules' sentences in the active language; those with a number for one and for more."""
    if translation.get_language() == settings.LANGUAGE_CODE:
        return {}
    sentences = {
        one: [ngettext(one, more, 1), ngettext(one, more, 2)] if more else gettext(one)
        for one, more in module_sentences(Path(settings.FRONTRUNNER_WEB_CLIENT))
    }
    return sentences | {TEACHES: gettext(TEACHES)}


@cache
def module_sentences(folder: Path) -> tuple[tuple[str, str], ...]:
    """Each sentence of the modules in `folder`, with its plural where it has a number, else ""."""
    return tuple(
        (json.loads(one), json.loads(more) if plural else "")
        for path in sorted(folder.glob("*.js"))
        for plural, one, more in CALL.findall(path.read_text(encoding="utf-8"))
    )
