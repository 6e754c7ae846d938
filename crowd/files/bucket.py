"""Files in a bucket of S3, or of another service with its interface. It needs the extra `s3`."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from boto3.exceptions import Boto3Error
from botocore.config import Config
from botocore.exceptions import BotoCoreError, ClientError
from django.core.files import File
from storages.backends.s3 import S3Storage

from crowd.files import UnavailableError

CLIENT = Config(connect_timeout=5, read_timeout=30, retries={"mode": "standard", "total_max_attempts": 3})
BUFFER_BYTES = 1 << 16


class Bucket(S3Storage):  # type: ignore[misc]  # django-storages has no types
    """The folder `name` below `url`, which is s3://BUCKET or s3://BUCKET/FOLDER.

    The account, the region and the address of another service are boto3's settings, the variables AWS_*.
    Raises UnavailableError if the service does not answer, FileNotFoundError without the object.
    """

    def __init__(self, url: str, name: str) -> None:
        bucket, _, folder = url.removeprefix("s3://").partition("/")
        location = f"{folder}/{name}" if folder else name
        super().__init__(bucket_name=bucket, location=location, client_config=CLIENT)

    def take(self, path: Path) -> None:
        """Store the file at `path` here under its name, and delete it there."""
        with answering(self.bucket_name):
            self._client.upload_file(str(path), self.bucket_name, self._normalize_name(path.name))
        path.unlink()

    def delete(self, name: str) -> None:
        """Delete the file, with all its versions if the bucket keeps them."""
        key = self._normalize_name(name)
        with answering(self.bucket_name):
            pages = self._client.get_paginator("list_object_versions")
            for page in pages.paginate(Bucket=self.bucket_name, Prefix=key):
                for version in (*page.get("Versions", ()), *page.get("DeleteMarkers", ())):
                    if version["Key"] == key:
                        self._client.delete_object(
                            Bucket=self.bucket_name, Key=key, VersionId=version["VersionId"]
                        )

    def exists(self, name: str) -> bool:
        """Whether there is a file `name`."""
        with answering(self.bucket_name):
            return bool(super().exists(name))

    def listdir(self, path: str) -> tuple[list[str], list[str]]:
        """The names of the folders and of the files in `path`."""
        with answering(self.bucket_name):
            folders, files = super().listdir(path)
        return folders, files

    def _open(self, name: str, mode: str = "rb") -> "File[bytes]":  # noqa: ARG002 - always read as bytes
        """The file for reading at any place: django-storages' own downloads an object whole."""
        content = _Object(self._client, self.bucket_name, self._normalize_name(name))
        return File(io.BufferedReader(content, BUFFER_BYTES), name)

    @property
    def _client(self) -> Any:
        return self.connection.meta.client


class _Object(io.RawIOBase):
    """An object of a bucket, streamed from where it is read. A read elsewhere begins another request."""

    def __init__(self, client: Any, bucket: str, key: str) -> None:
        self._bucket, self._get = bucket, partial(client.get_object, Bucket=bucket, Key=key)
        with answering(bucket):
            answer = self._get()
        self._size: int = answer["ContentLength"]
        # The object's bytes from the place `_next` on.
        self._body, self._next, self._position = answer["Body"], 0, 0

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
        with answering(self._bucket):
            if self._position != self._next:
                self._body.close()
                self._body = self._get(Range=f"bytes={self._position}-")["Body"]
                self._next = self._position
            content = self._body.read(len(buffer))
        buffer[: len(content)] = content
        self._position = self._next = self._position + len(content)
        return len(content)

    def close(self) -> None:
        self._body.close()
        super().close()


@contextmanager
def answering(bucket: str) -> Iterator[None]:
    """Raises what goes wrong in a request to `bucket` as UnavailableError, but FileNotFoundError for 404."""
    try:
        yield
    except ClientError as error:
        if error.response["ResponseMetadata"]["HTTPStatusCode"] == 404:
            raise FileNotFoundError(f"the bucket {bucket}: {error}") from error
        raise UnavailableError(f"the bucket {bucket}: {error}") from error
    except (BotoCoreError, Boto3Error) as error:
        raise UnavailableError(f"the bucket {bucket}: {error}") from error
