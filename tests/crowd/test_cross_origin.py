"""Pages of other origins read what is public, and nothing that is somebody's own."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from django.conf import settings
from django.test import Client
from django.urls import URLPattern, URLResolver, get_resolver

from crowd.results.opendata import exports
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant

ORIGIN = "https://notebook.example"
PREFLIGHT = {"Origin": ORIGIN, "Access-Control-Request-Method": "GET"}
EXPOSED = {
    "etag", "content-range", "accept-ranges", "content-location", "retry-after", "ratelimit",
    "ratelimit-policy", "link",
}  # fmt: skip
SHARED = {
    "vectors/kfusion.json.gz", "sequences/<str:sha256>", "trajectories/<str:sha256>", "plans/<str:sha256>",
    "data/", "data/<str:name>/", "data/<str:name>/<str:file>",
    "explorations/<int:key>/evaluations.csv", "explorations/<int:key>/evaluations.json",
    *(
        f"api/v1/{name}"
        for name in (
            "openapi.json", "compare", "devices", "devices/<slug:slug>", "explorations",
            "explorations/<int:key>", "exports", "fronts", "fronts/<str:version>", "models", "runs",
            "sessions", "sessions/<uuid:key>", "speedups",
        )
    ),
}  # fmt: skip
# Pages, what one person or one program has, and what only this server's pages need.
OWN = {
    "healthz", "readyz", "metrics", "shaders/<str:sha256>", "modules/<str:sha256>", "guide/",
    "guide/<path:path>", "^api/", "",
    *(
        f"api/v1/{name}"
        for name in (
            "attempts", "docs", "docs/<slug:key>", "enrol", "leases", "manifest", "me", "me/data",
            "me/runs/<uuid:key>", "me/token", "recommendation", "submissions", "submissions/<uuid:key>",
            "submissions:validate", "leases/<int:key>-<int:attempt>/heartbeat",
            "leases/<int:key>-<int:attempt>/result",
        )
    ),
    *(
        f"{name}/"
        for name in (
            "about", "compare", "devices", "devices/<slug:slug>", "explorations", "explorations/<int:key>",
            "explorations/<int:key>/live", "fronts", "fronts/<str:slug>", "measure", "mine/<str:signed>",
            "recommend", "runs/<uuid:uuid>", "search", "sessions/<uuid:uuid>", "surface", "transfer",
        )
    ),
    "card.png", "devices/<slug:slug>/card.png", "measure/<str:name>", "measure/key/",
}  # fmt: skip
VALUES = {"str": "x", "slug": "x", "int": "1", "path": "x", "uuid": "00000000-0000-0000-0000-000000000000"}


def addresses(patterns: Any, before: str = "") -> Iterator[str]:
    """The patterns of all addresses, except those of the administration."""
    for each in patterns:
        pattern = before + str(each.pattern)
        if isinstance(each, URLResolver) and not pattern.startswith("admin/"):
            yield from addresses(each.url_patterns, pattern)
        elif isinstance(each, URLPattern):
            yield pattern


def is_shared(pattern: str) -> bool:
    """Whether pages of other origins may read addresses of `pattern`."""
    path = re.sub(r"<(\w+):\w+>", lambda match: VALUES[match[1]], pattern)
    return re.match(settings.CORS_URLS_REGEX, f"/{path}") is not None


def test_every_address_is_in_one_group() -> None:
    every = set(addresses(get_resolver().url_patterns))
    tables = {pattern for pattern in every if pattern.startswith("tables/")}
    drawn = {pattern for pattern in every if pattern.startswith(("figures/", "embed/"))}

    assert every - tables - drawn == SHARED | OWN
    assert tables
    assert {pattern for pattern in every if is_shared(pattern)} == SHARED | tables


@pytest.mark.parametrize("path", ["/admin/", "/admin/results/export/", "/static/x.js", "/api/v1/exportsx"])
def test_nothing_else_is_shared(path: str) -> None:
    assert not re.match(settings.CORS_URLS_REGEX, path)


@pytest.mark.parametrize("file", ["nginx.conf", "Caddyfile"])
def test_the_proxies_have_the_same_addresses(file: str) -> None:
    assert settings.CORS_URLS_REGEX in (Path(settings.BASE_DIR) / "deploy" / file).read_text()


def check(answer: Any, status: int) -> None:
    """`answer` has this status, and a page of another origin may read it."""
    assert answer.status_code == status
    assert answer.headers["Access-Control-Allow-Origin"] == "*"
    assert "Access-Control-Allow-Credentials" not in answer.headers
    assert set(answer.headers["Access-Control-Expose-Headers"].lower().split(", ")) == EXPOSED


def test_every_answer_of_the_open_data_is_shared(
    client: Client, participant: Participant, settings: Any
) -> None:
    address = "/data/latest/runs.parquet"

    def ask(path: str, **headers: str) -> Any:
        return client.get(path, headers={"Origin": ORIGIN} | headers)

    check(ask(address), 503)
    participant.submit(submission_document())
    export = exports.create_export()
    whole = ask(address)
    check(whole, 200)
    check(ask(address, Range="bytes=0-3"), 206)
    check(ask(address, **{"If-None-Match": whole.headers["ETag"]}), 304)
    check(ask("/data/latest/nothing.parquet"), 404)
    check(ask(address, Range="bytes=99999999-"), 416)
    export.removed_at = export.published_at
    export.save()
    check(ask(f"/data/{export.name}/runs.parquet"), 410)
    settings.FRONTRUNNER_PAGES_PER_MINUTE = 1
    check(ask("/data/"), 429)


def test_a_preflight_costs_no_query_and_does_not_count(
    client: Client, db: None, django_assert_num_queries: Any, settings: Any
) -> None:
    settings.FRONTRUNNER_PAGES_PER_MINUTE = 2
    settings.FRONTRUNNER_READS_PER_MINUTE = 2
    with django_assert_num_queries(0):
        for _ in range(5):
            for path in ("/data/latest/runs.parquet", f"{API}/speedups"):
                answer = client.options(path, headers=PREFLIGHT)
                check(answer, 200)
                assert answer.headers["Access-Control-Allow-Methods"] == "GET, HEAD, OPTIONS"
                assert answer.headers["Access-Control-Allow-Headers"] == "range, if-none-match"
                assert "RateLimit" not in answer.headers

    assert "r=1" in client.get(f"{API}/speedups").headers["RateLimit"]


@pytest.mark.parametrize(
    "path", [f"{API}/me", f"{API}/enrol", f"{API}/manifest", "/measure/", "/metrics", "/"]
)
def test_what_is_own_is_not_shared(client: Client, db: None, path: str) -> None:
    for answer in (client.get(path, headers={"Origin": ORIGIN}), client.options(path, headers=PREFLIGHT)):
        assert not [name for name in answer.headers if name.startswith("Access-Control")]


def test_ranges_of_exports_have_a_limit_of_their_own(client: Client, db: None, settings: Any) -> None:
    settings.FRONTRUNNER_PAGES_PER_MINUTE = 2
    settings.FRONTRUNNER_RANGES_PER_MINUTE = 3
    exports.create_export()

    def read(**headers: str) -> tuple[int, str]:
        answer = client.get("/data/latest/runs.parquet", headers=headers)
        answer.getvalue()
        return answer.status_code, answer.headers["RateLimit"]

    parts = [read(Range="bytes=0-3") for _ in range(4)]

    assert [status for status, _ in parts] == [206, 206, 206, 429]
    assert parts[0][1].startswith('"ranges";r=2')
    assert read()[0] == 200


def test_lists_are_compressed_and_unchanged_ones_are_not_sent_again(
    client: Client, participant: Participant
) -> None:
    participant.submit(submission_document())
    exports.create_export()
    for name in ("speedups", "devices", "devices/google-pixel-8", "fronts", "fronts/kfusion-test", "exports",
                 "sessions", "runs", "openapi.json"):  # fmt: skip
        whole = client.get(f"{API}/{name}")
        packed = client.get(f"{API}/{name}", headers={"Accept-Encoding": "gzip"})
        again = client.get(f"{API}/{name}", headers={"If-None-Match": packed.headers["ETag"]})

        # Gzip would only lengthen the shortest.
        wanted = "gzip" if len(whole.content) > 1000 else packed.headers.get("Content-Encoding")
        assert (packed.status_code, packed.headers.get("Content-Encoding")) == (200, wanted), name
        assert (again.status_code, again.content) == (304, b""), name
