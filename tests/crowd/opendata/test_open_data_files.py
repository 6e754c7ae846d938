"""Files of exports: their addresses, how they are downloaded, how long they are kept."""

import hashlib
from datetime import timedelta
from typing import Any

import pytest
from django.test import Client
from django.utils import timezone

from crowd.results.models import Export, StoredFile
from crowd.results.opendata import exports, releases, storing
from crowd.results.opendata.tables import TABLES
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant
from tests.crowd.exported import age, all_files


def test_files_have_stable_addresses(client: Client, participant: Participant) -> None:
    participant.submit(submission_document())
    export = exports.create_export()

    listed = client.get(f"{API}/exports").json()["results"]

    assert [each["name"] for each in listed] == [export.name]
    assert listed[0]["licence"] == "CC-BY-4.0"
    for file in listed[0]["files"]:
        dated, latest = client.get(file["url"]), client.get(file["latest_url"])
        content = dated.getvalue()
        assert hashlib.sha256(content).hexdigest() == file["sha256"]
        assert latest.getvalue() == content
        assert latest.headers["Content-Location"] == file["url"]
        assert int(dated.headers["Content-Length"]) == file["bytes"] == len(content)
    assert client.get(listed[0]["schema"]).status_code == 200
    names = [file["name"] for file in listed[0]["files"]]
    assert names[:3] == ["runs.parquet", "runs.csv.gz", "run_states.parquet"]
    assert names[-4:] == ["recompute.py", "LICENCE.txt", "datapackage.json", "SHA256SUMS"]


@pytest.mark.parametrize(
    ("wanted", "first", "last"),
    [("bytes=0-3", 0, 3), ("bytes=-4", -4, None), ("bytes=10-", 10, None), ("bytes=0-0", 0, 0)],
)
def test_a_download_goes_on_where_it_broke_off(
    client: Client, db: None, wanted: str, first: int, last: int | None
) -> None:
    exports.create_export()
    address = "/data/latest/runs.parquet"
    whole = client.get(address)
    content = whole.getvalue()

    part = client.get(
        address,
        headers={"Range": wanted, "If-Range": whole.headers["ETag"], "Origin": "https://notebook.example"},
    )

    expected = content[first:] if last is None else content[first : last + 1]
    assert (part.status_code, part.getvalue()) == (206, expected)
    start = first % len(content)
    assert part.headers["Content-Range"] == f"bytes {start}-{start + len(expected) - 1}/{len(content)}"
    assert int(part.headers["Content-Length"]) == len(expected)
    assert part.headers["Access-Control-Allow-Origin"] == "*"
    assert "Content-Range" in part.headers["Access-Control-Expose-Headers"]


def test_ranges_that_do_not_fit(client: Client, db: None) -> None:
    exports.create_export()
    address = "/data/latest/runs.parquet"
    whole = client.get(address)
    size = len(whole.getvalue())

    beyond = client.get(address, headers={"Range": f"bytes={size}-"})
    changed = client.get(address, headers={"Range": "bytes=0-3", "If-Range": '"another"'})
    several = client.get(address, headers={"Range": "bytes=0-1,4-5"})
    endless = client.get(address, headers={"Range": f"bytes={'9' * 5000}-"})

    assert (beyond.status_code, beyond.headers["Content-Range"]) == (416, f"bytes */{size}")
    assert (changed.status_code, len(changed.getvalue())) == (200, size)
    assert (several.status_code, len(several.getvalue())) == (200, size)
    assert (endless.status_code, len(endless.getvalue())) == (200, size)


def test_an_unchanged_file_is_not_sent_again(client: Client, db: None) -> None:
    exports.create_export()
    etag = client.get("/data/latest/sessions.csv.gz").headers["ETag"]

    again = client.get("/data/latest/sessions.csv.gz", headers={"If-None-Match": etag})

    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.slow
@pytest.mark.parametrize(
    "address",
    [
        "/data/2020-01-01/runs.parquet",
        "/data/latest/nothing.parquet",
        "/data/latest/..%2fsecret_key",
        "/data/x/y",
        "/data/20200101/runs.parquet",
        "/data/9999-12-31/runs.parquet",
    ],
)
def test_what_is_no_file_of_an_export(client: Client, db: None, address: str) -> None:
    exports.create_export()

    assert client.get(address).status_code == 404


def test_an_export_is_made_once_a_night(db: None) -> None:
    assert exports.export_if_due() is not None
    assert exports.export_if_due() is None

    age(1)

    assert exports.export_if_due() is not None


def test_an_export_is_made_though_the_clock_was_set_back_since_the_last_one(db: None) -> None:
    assert exports.export_if_due() is not None
    age(-3)

    assert exports.export_if_due() is not None


def test_an_export_whose_process_died_is_made_again(db: None) -> None:
    now = timezone.now()
    export = Export.objects.create(started_at=now, touched_at=now)
    folder = storing.drafts() / f".export-{export.pk}"
    folder.mkdir(parents=True)
    assert exports.export_if_due() is None
    assert folder.exists()

    Export.objects.update(touched_at=now - exports.ABANDONED_AFTER - timedelta(seconds=1))

    assert exports.export_if_due() is not None
    assert not folder.exists()


def test_only_the_newest_exports_are_kept(client: Client, db: None, settings: Any) -> None:
    settings.FRONTRUNNER_EXPORTS_KEPT = 2
    for _ in range(3):
        exports.create_export()
        age(1)
    newest = exports.create_export()

    assert releases.listed_exports()[0].pk == newest.pk
    assert releases.published_exports().count() == 2
    stored = set(StoredFile.objects.values_list("stored_as", flat=True))
    assert all_files() == stored
    assert len(client.get(f"{API}/exports").json()["results"]) == 2


def test_the_first_export_is_announced_before_it_is_there(client: Client, db: None) -> None:
    answer = client.get("/data/latest/runs.parquet")

    assert (answer.status_code, answer.json()["code"]) == (503, "export_in_preparation")
    assert int(answer.headers["Retry-After"]) > 0


def test_the_page_links_every_file(client: Client, participant: Participant) -> None:
    before = client.get("/data/").content.decode()
    participant.submit(submission_document())
    exports.create_export()

    page = client.get("/data/").content.decode()

    assert "/data/latest/" not in before
    for name in (each.name for each in TABLES):
        assert f'href="/data/latest/{name}.parquet"' in page
        assert f'href="/data/latest/{name}.csv.gz"' in page
    assert "https://creativecommons.org/licenses/by/4.0/" in page
