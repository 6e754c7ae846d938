"""The manifest that tells clients what to measure, and the sequence that they download."""

import hashlib
from typing import Any

from django.test import Client

from crowd.fronts.models import FrontVersion, IntakePolicy
from crowd.fronts.publishing import services
from tests.builders.documents import front_document
from tests.builders.participant import API


def test_the_manifest_tells_front_protocol_and_sequence(
    client: Client, front: FrontVersion, pack: dict[str, Any]
) -> None:
    manifest = client.get(f"{API}/manifest", {"application": "kfusion"}).json()

    document = front_document(pack)
    assert manifest["front_version"] == "kfusion-test"
    shown = ("name", "parameters", "predicted", "band")
    assert [{name: point[name] for name in shown} for point in manifest["configurations"]] == [
        {name: point[name] for name in shown} for point in document["configurations"]
    ]
    assert manifest["protocol"] == document["protocol"]
    assert (manifest["accepting"], manifest["consent_version"]) == (True, 2)
    assert manifest["minimum_app_version"] == "0.1.0"
    sequence = manifest["sequence"]
    assert {name: sequence[name] for name in pack if name != "chunks"} == {
        name: value for name, value in pack.items() if name != "chunks"
    }
    assert [chunk["url"] for chunk in sequence["chunks"]] == [
        f"/sequences/{chunk['sha256']}" for chunk in pack["chunks"]
    ]


def test_an_unchanged_manifest_answers_304(client: Client, front: FrontVersion) -> None:
    first = client.get(f"{API}/manifest")

    again = client.get(f"{API}/manifest", headers={"If-None-Match": first.headers["ETag"]})

    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["ETag"] == first.headers["ETag"]


def test_everyone_gets_the_same_manifest_and_etag(client: Client, front: FrontVersion) -> None:
    first = client.get(f"{API}/manifest")

    for headers in ({"Accept": "text/html"}, {"Accept-Language": "de"}, {"Cookie": "sessionid=x"}):
        other = Client().get(f"{API}/manifest", headers=headers, REMOTE_ADDR="192.0.2.7")
        assert (other.content, other.headers["ETag"]) == (first.content, first.headers["ETag"])
    assert first.headers.get("Vary", "Accept-Encoding") == "Accept-Encoding"
    assert "Set-Cookie" not in first.headers


def test_a_new_front_or_a_closed_intake_changes_the_etag(
    client: Client, front: FrontVersion, pack: dict[str, Any]
) -> None:
    first = client.get(f"{API}/manifest")
    services.publish_content(front_document(pack, version="next"))

    second = client.get(f"{API}/manifest", headers={"If-None-Match": first.headers["ETag"]})
    IntakePolicy.objects.create(accepting=False)
    third = client.get(f"{API}/manifest", headers={"If-None-Match": second.headers["ETag"]})

    assert (second.status_code, second.json()["front_version"]) == (200, "kfusion-next")
    assert (third.status_code, third.json()["accepting"]) == (200, False)


def test_an_application_without_a_front(client: Client, front: FrontVersion) -> None:
    response = client.get(f"{API}/manifest", {"application": "elasticfusion"})

    assert (response.status_code, response.json()["code"]) == (404, "no_front")


def test_chunks_are_served_for_ever(client: Client, front: FrontVersion, pack: dict[str, Any]) -> None:
    for chunk in client.get(f"{API}/manifest").json()["sequence"]["chunks"]:
        response = client.get(chunk["url"])
        content = b"".join(response)  # type: ignore[arg-type]
        assert hashlib.sha256(content).hexdigest() == chunk["sha256"]
        assert "immutable" in response.headers["Cache-Control"]
        assert (
            client.get(chunk["url"], headers={"If-None-Match": response.headers["ETag"]}).status_code == 304
        )


def test_nothing_but_chunks_is_served(client: Client, front: FrontVersion) -> None:
    for name in ("0" * 64, "pack.json", "..%2Fpack.json", "../../secret_key"):
        assert client.get(f"/sequences/{name}").status_code == 404


def test_fronts_are_listed_and_shown(client: Client, front: FrontVersion, pack: dict[str, Any]) -> None:
    services.create_draft(front_document(pack, version="draft"))

    listed = client.get(f"{API}/fronts").json()["results"]
    shown = client.get(f"{API}/fronts/kfusion-test").json()

    assert [row["version"] for row in listed] == ["kfusion-test"]
    assert shown["provenance"] == {"note": "made up for testing", "evaluations": 0}
    assert client.get(f"{API}/fronts/kfusion-draft").status_code == 404
