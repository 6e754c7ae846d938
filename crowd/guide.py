"""The guide at /guide/: the pages that `make docs` built, or a page that says how to build them."""

from django.http import HttpRequest, HttpResponseBase
from django.shortcuts import render
from django.views.static import serve

from groundwork import folders


def guide(request: HttpRequest, path: str) -> HttpResponseBase:
    """One file of the guide. If the guide is not built, every address below /guide/ shows how to build it."""
    if not (folders.GUIDE / "index.html").is_file():
        return render(request, "guide/not_built.html")
    response: HttpResponseBase = serve(request, path or "index.html", document_root=str(folders.GUIDE))
    # An upgrade changes files under the same address: browsers ask each time, and mostly get 304.
    response["Cache-Control"] = "no-cache"
    return response
