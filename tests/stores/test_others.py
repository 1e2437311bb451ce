"""The stores of Google and of Azure, where their emulators are installed."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pyarrow.fs as fs
import pytest

from tests.conftest import Ran
from tests.places import SAMPLES
from tests.waiting import wait_until

KEY = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="
"""That of the account which Azure's emulator is documented to have: no secret."""
ACCOUNT = "devstoreaccount1"


def _listens(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
        return True
    return False


@contextmanager
def emulator(program: str, *arguments: str) -> Iterator[int]:
    """A server on a free port, which stands in the arguments as PORT."""
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [program, *(argument.replace("PORT", str(port)) for argument in arguments)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_until(lambda: _listens(port), process)
        yield port
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def gs(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A bucket of Google's store."""
    with emulator("gcp-storage-emulator", "start", "--host=127.0.0.1", "--port=PORT", "--in-memory") as port:
        monkeypatch.setenv("STORAGE_EMULATOR_HOST", f"http://127.0.0.1:{port}")
        fs.GcsFileSystem(anonymous=True, scheme="http", endpoint_override=f"127.0.0.1:{port}", project_id="p").create_dir(
            "robots"
        )
        yield "gs://robots"


@pytest.fixture
def az(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A container of Azure's store."""
    arguments = ("--blobHost", "127.0.0.1", "--blobPort", "PORT", "--skipApiVersionCheck", "--inMemoryPersistence")
    with emulator("azurite-blob", *arguments) as port:
        monkeypatch.setenv(
            "AZURE_STORAGE_CONNECTION_STRING",
            f"DefaultEndpointsProtocol=http;AccountName={ACCOUNT};AccountKey={KEY};"
            f"BlobEndpoint=http://127.0.0.1:{port}/{ACCOUNT};",
        )
        place = {f"{kind}_storage_authority": f"127.0.0.1:{port}" for kind in ("blob", "dfs")}
        schemes = {f"{kind}_storage_scheme": "http" for kind in ("blob", "dfs")}
        fs.AzureFileSystem(ACCOUNT, account_key=KEY, **place, **schemes).create_dir("robots")
        yield "az://robots"


@pytest.mark.parametrize("name", ["gs", "az"])
def test_the_commands_in_another_store(
    name: str, request: pytest.FixtureRequest, lidarcli: Callable[..., Ran], tmp_path: Path
) -> None:
    from lidarcli.files.stores import Url, place, put

    base = request.getfixturevalue(name)
    for log in ("room.mcap", "corridor.bag"):
        url = place(f"{base}/logs/{log}")
        assert isinstance(url, Url)
        put(SAMPLES / log, url)
    here = lidarcli("detect", SAMPLES / "room.mcap", SAMPLES / "corridor.bag", "-o", tmp_path)
    assert here.code == 0
    command = ("detect", f"{base}/logs/*", "-o", f"{base}/tables", "--resume")
    first = lidarcli(*command)
    assert first.code == 0, first.err
    assert "2 done before" in lidarcli(*command).err
    assert lidarcli("detect", f"{base}/logs/room.mcap", "-o", f"{base}/tables").code == 5
    for table in sorted(tmp_path.iterdir()):
        from lidarcli.files.stores import read_object

        stored = place(f"{base}/tables/{table.name}")
        assert isinstance(stored, Url)
        assert read_object(stored) == table.read_bytes()
    ran = lidarcli("detect", f"{base}/none.mcap")
    assert (ran.code, ran.err) == (3, f"lidarcli: {base}/none.mcap: no such object or folder\n")
    assert KEY not in first.err
    assert os.environ.get("AZURE_STORAGE_CONNECTION_STRING", "none") not in first.err
