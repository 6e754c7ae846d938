"""A bucket of a server that speaks the interface of S3."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

ACCOUNT = {
    "AWS_ACCESS_KEY_ID": "test",
    "AWS_SECRET_ACCESS_KEY": "test",
    "AWS_DEFAULT_REGION": "us-east-1",
}
# For tests of the open data that find out how files are written, replaced, deleted or served.
IN_BOTH_PLACES = pytest.mark.parametrize(
    "place", ["folder", pytest.param("bucket", marks=pytest.mark.slow)], indirect=True
)


@pytest.fixture(scope="session")
def s3() -> Iterator[str]:
    """The address of the server, which is moto's."""
    from moto.server import ThreadedMotoServer  # takes a second

    server = ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture
def bucket(s3: str, settings: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """boto3's bucket, empty, which keeps all versions of its objects. The server under test uses it."""
    import boto3

    for name, value in (ACCOUNT | {"AWS_ENDPOINT_URL": s3}).items():
        monkeypatch.setenv(name, value)
    name = f"test-{uuid4()}"
    bucket = boto3.resource("s3").create_bucket(Bucket=name)
    bucket.Versioning().enable()
    settings.STORAGES = settings.STORAGES | {
        each: {
            "BACKEND": "crowd.files.bucket.Bucket",
            "OPTIONS": {"url": f"s3://{name}/crowd", "name": each},
        }
        for each in ("exports", "sequences")
    }
    settings.FRONTRUNNER_SEQUENCES = [*settings.FRONTRUNNER_SEQUENCES, settings.FRONTRUNNER_VAR / "fetched"]
    return bucket


def upload(folder: Path, bucket: Any, name: str) -> None:
    """Copy all files of `folder` to `name` in `bucket`."""
    for file in (each for each in folder.rglob("*") if each.is_file()):
        bucket.upload_file(str(file), f"{name}/{file.relative_to(folder).as_posix()}")
