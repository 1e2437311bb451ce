"""The commands on logs and tables of an S3 store."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from tests.conftest import Ran
from tests.splitting import split_mcap
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


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("logs/*.mcap", ["one", "two words"]),
        ("logs/**/*.mcap", ["deep/er/one", "deep/one", "one", "two words"]),
        ("logs/*/one.mcap", ["deep/one"]),
        ("logs/[t-z]*", ["two words"]),
        ("logs/", ["bag", "deep/er/one", "deep/one", "one", "two words"]),
        ("logs/deep", ["er/one", "one"]),
        ("logs/b?g", ["bag"]),
        ("logs/d*", ["deep/er/one", "deep/one"]),
        ("logs/**", ["bag", "deep/er/one", "deep/one", "one", "two words"]),
        ("logs/one.mcap", ["one"]),
    ],
)
def test_folders_and_patterns(pattern: str, found: list[str], store: Store) -> None:
    for key in ("one.mcap", "two words.mcap", "deep/one.mcap", "deep/er/one.mcap", ".hidden.mcap", "notes.txt"):
        store.put(f"logs/{key}", b"x")
    store.put("logs2/other.mcap", b"x")
    for name in CONTAINERS["hall"]:
        store.put(f"logs/bag/{name.partition('/')[2]}", (SAMPLES / name).read_bytes())
    sources = find_logs([f"s3://{store.bucket}/{pattern}"])
    assert sorted(source.name for source in sources if isinstance(source, Source)) == found
    assert not any(isinstance(source, MissingInput) for source in sources)


def test_many_logs_are_found_by_few_requests(store: Store) -> None:
    for number in range(30):
        store.put(f"logs/run{number}.mcap", b"x")
    store.asked()
    found = find_logs([f"s3://{store.bucket}/logs/*.mcap"])
    assert len(found) == 30
    assert len(store.asked()) == 1
    assert all(isinstance(source, Source) and source.size == 1 for source in found)


def test_parts_are_joined_as_those_on_the_disk(store: Store, lidarcli: CommandLine, tmp_path: Path) -> None:
    parts = split_mcap(SAMPLES / "room.mcap", tmp_path / "parts")
    urls = [store.put(f"parts/{part.name}", part.read_bytes()) for part in parts]
    lidarcli("-q", "detect", "--join", tmp_path / "parts", "-o", tmp_path)
    for log in ([f"s3://{store.bucket}/parts/"], [f"s3://{store.bucket}/parts/*"], urls[::-1], [urls[0], *parts[1:]]):
        ran = lidarcli("-q", "detect", "--join", *log, "-o", tmp_path / "there", "--overwrite")
        assert (ran.code, ran.err) == (0, "")
        for table in ("room.objects.parquet", "room.sweeps.parquet"):
            assert (tmp_path / "there" / table).read_bytes() == (tmp_path / table).read_bytes()


def test_one_sweep_per_object_is_one_log(store: Store, lidarcli: CommandLine, tmp_path: Path) -> None:
    folder = tmp_path / "sweeps"
    folder.mkdir()
    for number in range(4):
        words = "\n".join(f"{angle},{2 + 0.1 * number}" for angle in range(-90, 91))
        (folder / f"{1700000000 + number}.csv").write_text(f"angle_deg,range\n{words}\n")
        store.put(f"sweeps/{1700000000 + number}.csv", (folder / f"{1700000000 + number}.csv").read_bytes())
    here = lidarcli("detect", folder, "-o", tmp_path / "here")
    assert here.code == 0, here.err
    for log in (f"s3://{store.bucket}/sweeps", f"s3://{store.bucket}/sweeps/*.csv"):
        there = lidarcli("detect", log, "-o", tmp_path / "there", "--overwrite")
        assert there.code == 0, there.err
        one, other = (tmp_path / where / "sweeps.sweeps.parquet" for where in ("here", "there"))
        assert pq.read_table(one).equals(pq.read_table(other))


def test_resuming_in_a_store_reads_only_what_is_left(store: Store, lidarcli: CommandLine) -> None:
    data = (SAMPLES / "room.mcap").read_bytes()
    for name in ("one", "two", "three"):
        store.put(f"logs/{name}.mcap", data)
    command = ("detect", f"s3://{store.bucket}/logs/*.mcap", "-o", f"s3://{store.bucket}/tables", "--resume")
    assert lidarcli(*command).code == 0
    store.put("logs/two.mcap", data + b" ")
    store.put("logs/four.mcap", data)
    store.asked()
    ran = lidarcli(*command)
    assert "4 logs" in ran.err
    assert "2 done before" in ran.err
    read = {path for method, path in store.asked() if "/logs/" in path}
    assert read == {"/robots/logs/two.mcap", "/robots/logs/four.mcap"}


def test_tables_in_a_store_are_reported(store: Store, lidarcli: CommandLine, tmp_path: Path) -> None:
    url = store.put("run.mcap", (SAMPLES / "room.mcap").read_bytes())
    for layout, where in (((), "flat"), (("--partition", "table"), "by")):
        assert lidarcli("track", url, "-o", f"s3://{store.bucket}/{where}", *layout).code == 0
    assert lidarcli("track", SAMPLES / "room.mcap", "-o", tmp_path / "here").code == 0
    figures = [
        json.loads(lidarcli("report", tables, "--format", "json").out)["figures"]
        for tables in (
            tmp_path / "here",
            f"s3://{store.bucket}/flat",
            f"s3://{store.bucket}/flat/run.objects.parquet",
            f"s3://{store.bucket}/by/",
            f"s3://{store.bucket}/by/objects/*.parquet",
        )
    ]
    assert all(each == figures[0] for each in figures)
    out = f"s3://{store.bucket}/report.html"
    assert lidarcli("report", f"s3://{store.bucket}/flat", "-o", out, "--log", url).code == 0
    assert store.get("report.html").startswith(b"<!")
    assert lidarcli("report", f"s3://{store.bucket}/flat", "-o", out).code == 5


def test_backgrounds_maps_and_single_files(store: Store, lidarcli: CommandLine, tmp_path: Path) -> None:
    for name in ("room.mcap", "room_empty.mcap"):
        store.put(name, (SAMPLES / name).read_bytes())
    store.put("drive.db3", (SAMPLES / "drive.db3").read_bytes())
    base = f"s3://{store.bucket}"
    background = f"{base}/empty.background.parquet"
    assert lidarcli("background", "build", f"{base}/room_empty.mcap", "-o", background).code == 0
    assert lidarcli("info", background).code == 0
    ran = lidarcli("detect", f"{base}/room.mcap", "--background", background, "-o", f"{base}/t/")
    assert ran.code == 0, ran.err
    ran = lidarcli("map", f"{base}/drive.db3", "-o", f"{base}/map.yaml", "-o", f"{base}/cloud.parquet")
    assert ran.code == 0, ran.err
    assert lidarcli("detect", f"{base}/room.mcap", "-o", f"{base}/all.csv").code == 0
    assert lidarcli("map", SAMPLES / "drive.db3", "-o", tmp_path / "map.yaml").code == 0
    assert store.get("map.pgm") == (tmp_path / "map.pgm").read_bytes()
    assert store.get("map.yaml") == (tmp_path / "map.yaml").read_bytes()
    assert {"all.csv", "cloud.parquet", "t/room.objects.parquet"} <= {*store.keys()}
    info = lidarcli("info", f"{base}/room.mcap", "--format", "json")
    here = json.loads(lidarcli("info", SAMPLES / "room.mcap", "--format", "json").out)
    assert json.loads(info.out)[0]["scans"] == here[0]["scans"]


def test_an_output_that_exists_is_refused(store: Store, lidarcli: CommandLine) -> None:
    url = store.put("run.mcap", (SAMPLES / "room.mcap").read_bytes())
    out = f"s3://{store.bucket}/tables"
    assert lidarcli("detect", url, "-o", out).code == 0
    again = lidarcli("detect", url, "-o", out)
    assert again.code == 5
    assert f"{out}/run.objects.parquet exists; use --overwrite to replace it" in again.err
    assert lidarcli("detect", url, "-o", out, "--overwrite").code == 0


@pytest.mark.parametrize(
    ("log", "cause"),
    [
        ("s3://robots/none.mcap", "no such object or folder"),
        ("s3://robots/*.mcap", "no such object or folder"),
        ("s3://nobody-has-this/run.mcap", "there is no such bucket"),
        ("s3://nobody-has-this/", "there is no such bucket"),
    ],
)
def test_what_is_not_there_is_one_line(log: str, cause: str, store: Store, lidarcli: CommandLine) -> None:
    ran = lidarcli("detect", log, "-o", f"s3://{store.bucket}/tables")
    assert ran.code == 3
    assert ran.err.splitlines()[0] == f"lidarcli: {log}: {cause}"


def test_a_store_that_is_not_there(store: Store, process: Callable[..., subprocess.CompletedProcess[bytes]]) -> None:
    environment = {**os.environ, "AWS_ENDPOINT_URL": "http://127.0.0.1:1"}
    ran = process("detect", "s3://robots/run.mcap", env=environment)
    assert ran.returncode == 3
    assert ran.stderr.decode() == (
        "lidarcli: s3://robots/run.mcap: the store cannot be reached: nobody answers at http://127.0.0.1:1 "
        "(AWS_ENDPOINT_URL_S3 or AWS_ENDPOINT_URL)\n"
    )
    ran = process("detect", SAMPLES / "room.mcap", "-o", "s3://robots/tables", env=environment)
    assert ran.returncode == 5
    assert b"cannot write s3://robots/tables: the store cannot be reached" in ran.stderr


@pytest.mark.parametrize(
    ("url", "cause"),
    [
        ("s3://robots/a//b.mcap", "names with an empty part (//) cannot be read or written"),
        ("s3://robots//b.mcap", "names with an empty part (//) cannot be read or written"),
        ("s3:///b.mcap", "names no bucket"),
        ("s3://robots/caf\udce9.mcap", "is not UTF-8"),
        ("s3://robots/a.mcap?access_key=A&secret_key=SECRET", "credentials do not belong in a URL"),
    ],
)
def test_urls_that_are_refused(url: str, cause: str, store: Store, lidarcli: CommandLine) -> None:
    for arguments in ((url,), (SAMPLES / "room.mcap", "-o", url)):
        ran = lidarcli("detect", *arguments)
        assert (ran.code, len(ran.err.splitlines())) == (2, 1), ran.err
        assert cause in ran.err
        assert "SECRET" not in ran.err


def test_odd_names_are_read_or_told(store: Store, lidarcli: CommandLine, tmp_path: Path) -> None:
    data = (SAMPLES / "room.mcap").read_bytes()
    for key in ("odd/br[1].mcap", "odd/50%.mcap", "odd/a b#c.mcap", "odd/z.mcap?token=1.mcap"):
        store.put(key, data)
    for name in CONTAINERS["hall"]:
        store.put(f"odd/hall[1]/{name.partition('/')[2]}", (SAMPLES / name).read_bytes())
    ran = lidarcli("detect", f"s3://{store.bucket}/odd/", "-o", tmp_path / "out")
    assert ran.code == 3
    assert "odd/z.mcap?token=...: its name cannot be that of a URL" in ran.err
    found = {path.name for path in (tmp_path / "out").glob("*.objects.parquet")}
    assert found == {f"{log}.objects.parquet" for log in ("br[1]", "50%", "a b#c", "hall[1]")}
    for name in ("br[1].mcap", "hall[1]"):
        ran = lidarcli("detect", f"s3://{store.bucket}/odd/{name}", "-o", tmp_path / name)
        assert (ran.code, name) == (0, name), ran.err
    for pattern in ("[z-a]*", "[[]*", "[!]*", "[", "**", "a**b"):
        ran = lidarcli("detect", f"s3://{store.bucket}/none/{pattern}", "-o", tmp_path / "p")
        assert (ran.code, len(ran.err.splitlines())) == (3, 1), ran.err


def test_a_key_that_is_none_does_not_end_the_process(process: Callable[..., subprocess.CompletedProcess[bytes]]) -> None:
    told = {"AZURE_STORAGE_CONNECTION_STRING": "AccountName=a;AccountKey=not-base64-SECRET"}
    ran = process("detect", "az://container/run.mcap", env={**os.environ, **told})
    assert ran.returncode == 2
    assert b"it is no Base64" in ran.stderr
    assert b"SECRET" not in ran.stderr


def test_from_python(store: Store, tmp_path: Path) -> None:
    import lidarcli as package

    url = store.put("run.mcap", (SAMPLES / "room.mcap").read_bytes())
    here = package.detect(SAMPLES / "room.mcap")
    there = package.detect(url)
    assert there.drop_columns(["log"]).equals(here.drop_columns(["log"]))
    package.background(url, f"s3://{store.bucket}/run.background.parquet")
    assert "run.background.parquet" in set(store.keys())
