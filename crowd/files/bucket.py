"""Files in a bucket of S3, or of another service with its interface. It needs the extra `s3`."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from http import HTTPStatus
from pathlib import Path
from typing import Any

import boto3
from botocore.config import Config
from botocore.exceptions import BotoCoreError, ClientError
from django.core.files import File
from django.core.files.storage import Storage

from crowd.files import UnavailableError

# A request that fails for all of this takes half a minute.
CLIENT = Config(connect_timeout=5, read_timeout=10, retries={"mode": "standard", "total_max_attempts": 2})
BUFFER_BYTES = 1 << 16


class Bucket(Storage):
    """The folder `name` below `url`, which is s3://BUCKET or s3://BUCKET/FOLDER.

    The account, the region and the address of another service are boto3's settings, the variables AWS_*.
    Raises UnavailableError if the service does not answer, FileNotFoundError without the object.
    """

    def __init__(self, url: str, name: str) -> None:
        self._bucket, _, folder = url.removeprefix("s3://").partition("/")
        self._folder = f"{folder}/{name}/" if folder else f"{name}/"

    @cached_property
    def _client(self) -> Any:
        """One for all threads."""
        return boto3.client("s3", config=CLIENT)

    def take(self, path: Path) -> None:
        """Store the file at `path` here under its name, and delete it there."""
        with path.open("rb") as file:
            # At once: parts of an upload that breaks off would stay, and no list shows them.
            self._ask("put_object", path.name, Body=file)
        path.unlink()

    def delete(self, name: str) -> None:
        """Delete the file, with all its versions if the bucket keeps them.

        Marks of deletion come first: if this breaks off, `listdir` shows the file again.
        """
        for kind in ("DeleteMarkers", "Versions"):
            for page in self._pages("list_object_versions", Prefix=self._key(name)):
                for version in page.get(kind, ()):
                    if version["Key"] == self._key(name):
                        self._ask("delete_object", name, VersionId=version["VersionId"])

    def exists(self, name: str) -> bool:
        """Whether there is a file `name`."""
        try:
            self._ask("head_object", name)
        except FileNotFoundError:
            return False
        return True

    def listdir(self, path: str) -> tuple[list[str], list[str]]:
        """The names of the folders and of the files in `path`."""
        prefix = self._key(f"{path}/" if path else "")
        folders, files = [], []
        for page in self._pages("list_objects_v2", Prefix=prefix, Delimiter="/"):
            folders += [each["Prefix"].removeprefix(prefix)[:-1] for each in page.get("CommonPrefixes", ())]
            files += [each["Key"].removeprefix(prefix) for each in page.get("Contents", ())]
        return folders, [name for name in files if name]

    def _open(self, name: str, mode: str = "rb") -> "File[bytes]":  # noqa: ARG002 - always read as bytes
        size: int = self._ask("head_object", name)["ContentLength"]
        content = _Object(partial(self._ask, "get_object", name), self._bucket, size)
        return File(io.BufferedReader(content, BUFFER_BYTES), name)

    def _key(self, name: str) -> str:
        return f"{self._folder}{name}"

    def _ask(self, operation: str, name: str, **arguments: Any) -> Any:
        with answering(self._bucket):
            return getattr(self._client, operation)(Bucket=self._bucket, Key=self._key(name), **arguments)

    def _pages(self, operation: str, **arguments: str) -> Iterator[dict[str, Any]]:
        with answering(self._bucket):
            yield from self._client.get_paginator(operation).paginate(Bucket=self._bucket, **arguments)


class _Object(io.RawIOBase):
    """An object of `size` bytes, streamed from where it is read. A read elsewhere begins another request."""

    def __init__(self, get: Any, bucket: str, size: int) -> None:
        self._get, self._bucket, self._size = get, bucket, size
        # `_body` has the object's bytes from the place `_next` on.
        self._body: Any = None
        self._next = self._position = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        origin = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self._size}[whence]
        self._position = origin + offset
        return self._position

    def readinto(self, buffer: Any, /) -> int:
        if self._position >= self._size:
            return 0
        try:
            content = self._read(len(buffer))
        except UnavailableError:  # the connection broke
            self._end()
            content = self._read(len(buffer))
        buffer[: len(content)] = content
        self._position = self._next = self._position + len(content)
        return len(content)

    def close(self) -> None:
        self._end()
        super().close()

    def _read(self, count: int) -> bytes:
        if self._position != self._next:
            self._end()
        if self._body is None:
            self._body = self._get(Range=f"bytes={self._position}-")["Body"]
            self._next = self._position
        with answering(self._bucket):
            return bytes(self._body.read(count))

    def _end(self) -> None:
        body, self._body = self._body, None
        if body is not None:
            body.close()


@contextmanager
def answering(bucket: str) -> Iterator[None]:
    """Raises what goes wrong in a request to `bucket` as UnavailableError, but FileNotFoundError for 404."""
    try:
        yield
    except ClientError as error:
        if error.response["ResponseMetadata"]["HTTPStatusCode"] == HTTPStatus.NOT_FOUND:
            raise FileNotFoundError(f"the bucket {bucket}: {error}") from error
        raise UnavailableError(f"the bucket {bucket}: {error}") from error
    except BotoCoreError as error:
        raise UnavailableError(f"the bucket {bucket}: {error}") from error
