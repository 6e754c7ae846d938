"""Files of exports: their addresses, how they are downloaded, how long they are kept."""

import hashlib
from datetime import timedelta
from typing import Any

from django.test import Client
from django.utils import timezone

from crowd.results.models import Export, StoredFile
from crowd.results.opendata import exports, releases, storing
from crowd.results.opendata.tables import TABLES
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant
from tests.crowd.buckets import IN_BOTH_PLACES
from tests.crowd.exported import age, all_files

RUNS = "/data/latest/runs.parquet"


@IN_BOTH_PLACES
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


@IN_BOTH_PLACES
def test_a_download_goes_on_where_it_broke_off(client: Client, db: None) -> None:
    exports.create_export()
    whole = client.get(RUNS)
    content = whole.getvalue()
    headers = {"If-Range": whole.headers["ETag"], "Origin": "https://notebook.example"}
    size = len(content)
    wanted = {"0-3": (0, 3), "-4": (size - 4, size - 1), "10-": (10, size - 1), "0-0": (0, 0)}

    parts = {name: client.get(RUNS, headers=headers | {"Range": f"bytes={name}"}) for name in wanted}

    for name, (first, last) in wanted.items():
        part = parts[name]
        assert (part.status_code, part.getvalue()) == (206, content[first : last + 1]), name
        assert part.headers["Content-Range"] == f"bytes {first}-{last}/{size}"
        assert int(part.headers["Content-Length"]) == last + 1 - first
        assert part.headers["Access-Control-Allow-Origin"] == "*"
        assert "Content-Range" in part.headers["Access-Control-Expose-Headers"]


@IN_BOTH_PLACES
def test_ranges_that_do_not_fit(client: Client, db: None) -> None:
    exports.create_export()
    size = len(client.get(RUNS).getvalue())

    beyond = client.get(RUNS, headers={"Range": f"bytes={size}-"})
    others = {
        "of another file": client.get(RUNS, headers={"Range": "bytes=0-3", "If-Range": '"another"'}),
        "several": client.get(RUNS, headers={"Range": "bytes=0-1,4-5"}),
        "beyond reason": client.get(RUNS, headers={"Range": f"bytes={'9' * 5000}-"}),
    }

    assert (beyond.status_code, beyond.headers["Content-Range"]) == (416, f"bytes */{size}")
    sent = {name: (answer.status_code, len(answer.getvalue())) for name, answer in others.items()}
    assert sent == dict.fromkeys(others, (200, size))


@IN_BOTH_PLACES
def test_an_unchanged_file_is_not_sent_again(client: Client, db: None) -> None:
    exports.create_export()
    etag = client.get("/data/latest/sessions.csv.gz").headers["ETag"]

    again = client.get("/data/latest/sessions.csv.gz", headers={"If-None-Match": etag})

    assert (again.status_code, again.content) == (304, b"")


def test_what_is_no_file_of_an_export(client: Client, db: None) -> None:
    exports.create_export()
    addresses = (
        "2020-01-01/runs.parquet", "latest/nothing.parquet", "latest/..%2fsecret_key", "x/y",
        "20200101/runs.parquet", "9999-12-31/runs.parquet",
    )  # fmt: skip

    statuses = {address: client.get(f"/data/{address}").status_code for address in addresses}

    assert statuses == dict.fromkeys(addresses, 404)


def test_an_export_is_made_once_a_night(db: None) -> None:
    assert exports.export_if_due() is not None
    assert exports.export_if_due() is None

    age(1)
    assert exports.export_if_due() is not None

    age(-3)  # the clock was set back since
    assert exports.export_if_due() is not None


@IN_BOTH_PLACES
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


@IN_BOTH_PLACES
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
    answer = client.get(RUNS)

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
