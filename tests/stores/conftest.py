"""An S3 store of our own, and what it was asked."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow.fs as fs
import pytest

from benchmarks.fleet import REQUEST, s3_server

CREDENTIALS = {"AWS_ACCESS_KEY_ID": "AKIATESTING", "AWS_SECRET_ACCESS_KEY": "a-secret-that-nobody-prints"}


@dataclass
class Store:
    """A bucket of a server, asked by pyarrow and by the command line alike."""

    endpoint: str
    words: Path
    """What the server says of each request."""
    bucket: str = "robots"
    _seen: int = 0

    @property
    def system(self) -> fs.S3FileSystem:
        return fs.S3FileSystem(
            endpoint_override=self.endpoint,
            access_key=CREDENTIALS["AWS_ACCESS_KEY_ID"],
            secret_key=CREDENTIALS["AWS_SECRET_ACCESS_KEY"],
            region="us-east-1",
            allow_bucket_creation=True,
            allow_bucket_deletion=True,
        )

    @property
    def environment(self) -> dict[str, str]:
        """What a process needs to find it."""
        return {**CREDENTIALS, "AWS_ENDPOINT_URL": self.endpoint, "AWS_DEFAULT_REGION": "us-east-1"}

    def put(self, key: str, data: bytes) -> str:
        """Store an object; its URL."""
        with self.system.open_output_stream(f"{self.bucket}/{key}", compression=None) as out:
            out.write(data)
        return f"s3://{self.bucket}/{key}"

    def get(self, key: str) -> bytes:
        with self.system.open_input_stream(f"{self.bucket}/{key}", compression=None) as file:
            return bytes(file.read())

    def keys(self, below: str = "") -> list[str]:
        selector = fs.FileSelector(f"{self.bucket}/{below}", recursive=True, allow_not_found=True)
        return sorted(
            info.path.removeprefix(f"{self.bucket}/")
            for info in self.system.get_file_info(selector)
            if info.type == fs.FileType.File
        )

    def asked(self) -> list[tuple[str, str]]:
        """Method and path of every request since the last call."""
        found = REQUEST.findall(self.words.read_text())
        new, self._seen = found[self._seen :], len(found)
        return new


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A server for all tests of this process."""
    with s3_server(tmp_path_factory.mktemp("moto")) as (endpoint, words):
        yield Store(endpoint, words)


@pytest.fixture
def store(server: Store, monkeypatch: pytest.MonkeyPatch) -> Iterator[Store]:
    """An empty bucket, which the environment tells of as it does of a store of one's own."""
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    for name, value in server.environment.items():
        monkeypatch.setenv(name, value)
    server.system.create_dir(server.bucket)
    server.asked()
    yield server
    server.system.delete_dir_contents(server.bucket)
