"""The commands on logs and tables of an S3 store."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import Ran
from tests.stores.conftest import CREDENTIALS, Store

CommandLine = Callable[..., Ran]
pytestmark = pytest.mark.usefixtures("nothing_left_behind")

SAMPLES = Path(__file__).parents[2] / "samples"
CONTAINERS = {
    "room.mcap": ["room.mcap"],
    "corridor.bag": ["corridor.bag"],
    "drive.db3": ["drive.db3"],
    "people.csv.gz": ["people.csv.gz"],
    "hall": sorted(path.relative_to(SAMPLES).as_posix() for path in (SAMPLES / "hall").iterdir()),
}


@pytest.mark.parametrize("name", CONTAINERS)
def test_every_container_gives_the_same_bytes_as_from_the_disk(
    name: str, store: Store, lidarcli: CommandLine, tmp_path: Path
) -> None:
    for file in CONTAINERS[name]:
        store.put(f"logs/{file}", (SAMPLES / file).read_bytes())
    here = lidarcli("detect", str(SAMPLES / name), "-o", tmp_path / "tables")
    there = lidarcli("detect", f"s3://{store.bucket}/logs/{name}", "-o", f"s3://{store.bucket}/tables")
    assert (here.code, there.code) == (0, 0), there.err
    tables = sorted(path.name for path in (tmp_path / "tables").iterdir())
    assert store.keys("tables") == [f"tables/{table}" for table in tables]
    for table in tables:
        assert store.get(f"tables/{table}") == (tmp_path / "tables" / table).read_bytes()


def test_a_log_is_fetched_once_and_each_table_put_once(store: Store, lidarcli: CommandLine) -> None:
    url = store.put("drive.mcap", (SAMPLES / "room.mcap").read_bytes())
    store.asked()
    assert lidarcli("detect", url, "-o", f"s3://{store.bucket}/tables", "--overwrite").code == 0
    asked = store.asked()
    reads = [path for method, path in asked if method == "GET" and "drive.mcap" in path]
    assert len(reads) <= 3
    assert sorted(path for method, path in asked if method in ("PUT", "POST")) == [
        "/robots/tables/drive.objects.parquet",
        "/robots/tables/drive.sweeps.parquet",
    ]


def test_credentials_stand_nowhere(store: Store, lidarcli: CommandLine, tmp_path: Path) -> None:
    url = store.put("run.mcap", (SAMPLES / "room.mcap").read_bytes())
    ran = lidarcli("-v", "detect", url, "-o", tmp_path / "tables")
    assert ran.code == 0
    written = b"".join(path.read_bytes() for path in (tmp_path / "tables").rglob("*") if path.is_file())
    for secret in CREDENTIALS.values():
        assert secret not in ran.err + ran.out
        assert secret.encode() not in written


@pytest.mark.parametrize("url", ["s3://KEY:SECRET@robots/run.mcap", "s3://SECRET@robots/run.mcap"])
def test_credentials_in_a_url_are_refused_and_not_repeated(url: str, lidarcli: CommandLine) -> None:
    ran = lidarcli("detect", url)
    assert ran.code == 2
    assert "credentials do not belong in a URL" in ran.err
    assert "SECRET" not in ran.err
