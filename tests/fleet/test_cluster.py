"""Runs on a Dask cluster: the same bytes as here, whatever becomes of the workers."""

from __future__ import annotations

import datetime
import json
import os
import pickle
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import NameOID

from benchmarks.fleet import KILLER, workers_of
from lidarcli.cli.runs import refuse_elsewhere
from lidarcli.errors import OutputError
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs import cluster
from lidarcli.pipeline.runs.manifest import read_entries
from lidarcli.pipeline.runs.outcomes import Outcome
from tests.conftest import Ran
from tests.descendants import descendants, gone
from tests.fleet.conftest import tables
from tests.places import SAMPLES
from tests.waiting import HANG, wait_until

distributed = pytest.importorskip("distributed")
pytestmark = [pytest.mark.whole, pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")]

CommandLine = Callable[..., Ran]


@pytest.fixture
def preload(tmp_path: Path) -> dict[str, str]:
    """The environment of a run whose workers die of `killer.mcap`."""
    path = tmp_path / "killer.py"
    path.write_text(KILLER)
    return {**os.environ, "DASK_DISTRIBUTED__WORKER__PRELOAD": repr([str(path)])}


def begin(*arguments: object, env: dict[str, str]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "lidarcli", *map(str, arguments)]
    return subprocess.Popen(command, env=env, stderr=subprocess.PIPE, stdout=subprocess.PIPE)


def test_a_worker_that_is_killed_and_a_log_that_kills(
    bags: Path, small: bytes, tmp_path: Path, preload: dict[str, str], lidarcli: CommandLine
) -> None:
    for number in range(60):
        (bags / f"more{number}.mcap").write_bytes(small)
    assert lidarcli("detect", bags, "-o", tmp_path / "here").code == 0
    (bags / "killer.mcap").write_bytes(small)
    out = tmp_path / "there"
    process = begin("detect", bags, "-o", out, "--cluster", "local:2", env=preload)
    wait_until(lambda: len([*out.glob("*.sweeps.parquet")]) >= 5, process)
    os.kill(workers_of(process.pid)[0], signal.SIGKILL)
    _, said = process.communicate(timeout=HANG)
    lines = [line for line in said.decode().splitlines() if line.startswith("lidarcli:")]
    assert lines == [
        f"lidarcli: {bags}/killer.mcap: ends every worker that reads it (out of memory?); try it alone, without --cluster"
    ]
    assert process.returncode == 3
    assert tables(out) == tables(tmp_path / "here")
    (failed,) = [entry for entry in read_entries(out)[0] if entry.outcome != "ok"]
    assert (failed.log, failed.outcome, failed.exit_code) == ("killer", "failed", 3)
    again = lidarcli("detect", bags, "-o", out, "--resume")
    assert (again.code, "67 logs, 66 done before" in again.err) == (0, True)


DIES = """
import os, signal
for number in range(99):
    try:
        os.close(os.open(os.path.join({folder!r}, f"start-{{number}}"), os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        continue
    break
if number in {numbers}:
    os.kill(os.getpid(), signal.SIGKILL)
"""
"""Of the workers that load it those of some numbers are killed while they start."""


@pytest.mark.parametrize("numbers", [(0,), tuple(range(99))])
def test_a_worker_that_is_killed_while_it_starts(
    numbers: tuple[int, ...], bags: Path, tmp_path: Path, process: Callable[..., subprocess.CompletedProcess[bytes]]
) -> None:
    path = tmp_path / "dies.py"
    path.write_text(DIES.format(numbers=numbers, folder=str(tmp_path)))
    environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__PRELOAD": repr([str(path)])}
    ran = process("detect", bags, "-o", tmp_path / "out", "--cluster", "local:1", env=environment)
    if len(numbers) == 1:
        assert (ran.returncode, len(tables(tmp_path / "out"))) == (0, 12), ran.stderr
        first, *_ = ran.stderr.decode().splitlines()
        assert first.startswith("cluster tcp://127.0.0.1:")
        assert first.endswith(": 1 worker, 1 thread")
        return
    assert ran.returncode == 2
    assert ran.stderr.decode().splitlines() == [
        "lidarcli: --cluster local:1: a worker ended while it started, 3 times (out of memory?); take fewer workers, or "
        "--jobs in their place"
    ]
    assert len([*tmp_path.glob("start-*")]) == 3


def test_a_worker_that_is_killed_while_it_starts_again(
    bags: Path, small: bytes, tmp_path: Path, process: Callable[..., subprocess.CompletedProcess[bytes]]
) -> None:
    """Its nanny gives it up, and it was the only one."""
    path = tmp_path / "dies.py"
    path.write_text(DIES.format(numbers=(1,), folder=str(tmp_path)) + KILLER)
    environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__PRELOAD": repr([str(path)])}
    (bags / "killer.mcap").write_bytes(small)
    ran = process("detect", bags, "-o", tmp_path / "out", "--cluster", "local:1", env=environment)
    assert ran.returncode == 3
    lines = [line for line in ran.stderr.decode().splitlines() if line.startswith("lidarcli:")]
    assert len(lines) == 1
    assert lines[0].startswith(f"lidarcli: {bags}/killer.mcap: ends every worker that reads it")
    assert len(tables(tmp_path / "out")) == 12


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Start a scheduler and a worker as processes of their own; its address."""
    started: list[subprocess.Popen[bytes]] = []

    def start(*workers: dict[str, str], protocol: str = "tcp", **config: str) -> str:
        file = tmp_path / "scheduler.json"
        environment = {**os.environ, **config}
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
        place = ["--host", f"{protocol}://127.0.0.1", "--port", "0", "--scheduler-file", str(file)]
        started.append(subprocess.Popen([*command, *place], env=environment, stderr=subprocess.DEVNULL))
        wait_until(lambda: file.exists() and file.read_text(), started[-1])
        address: str = json.loads(file.read_text())["address"]
        for extra in workers:
            started.append(
                subprocess.Popen(
                    [
                        *(sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1"),
                        *("--no-dashboard", "--local-directory", str(tmp_path / "scratch")),
                    ],
                    env={**environment, **extra},
                    stderr=subprocess.DEVNULL,
                )
            )
        return address

    yield start
    for process in started:
        process.terminate()
    for process in started:
        process.wait(20)


def test_a_cluster_that_was_there(
    scheduler: Callable[..., str],
    bags: Path,
    tmp_path: Path,
    lidarcli: CommandLine,
    process: Callable[..., subprocess.CompletedProcess[bytes]],
) -> None:
    address = scheduler({}, {})
    (tmp_path / "elsewhere").mkdir()
    assert lidarcli("track", bags, "-o", tmp_path / "here").code == 0
    ran = process("track", "bags", "-o", "there", "--cluster", address, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert f"cluster {address}: " in ran.stderr.decode()
    assert tables(tmp_path / "there") == tables(tmp_path / "here")


HOSTILE = """
import os
from distributed.protocol.serialize import Serialize, ToPickle

class Evil(Exception):
    def __reduce__(self):
        return os.mkdir, ({mark!r},)

def dask_setup(server):
    async def answer(*arguments, **named):
        return {answer}

    server.handlers[{handler!r}] = answer
"""
"""Whoever unpickles what such a server answers makes a folder."""


@pytest.mark.parametrize(
    ("who", "handler", "answer"),
    [
        ("WORKER", "run", '{"status": "OK", "result": Serialize(Evil())}'),
        ("WORKER", "run", '{"status": "error", "exception": Serialize(Evil()), "traceback": None}'),
        ("SCHEDULER", "broadcast", '{"tcp://worker:1": __import__("pickle").dumps(Evil())}'),
        ("SCHEDULER", "ncores", "ToPickle(Evil())"),
    ],
)
def test_what_a_cluster_answers_runs_nothing_here(
    who: str,
    handler: str,
    answer: str,
    scheduler: Callable[..., str],
    bags: Path,
    tmp_path: Path,
    process: Callable[..., subprocess.CompletedProcess[bytes]],
) -> None:
    mark, path = tmp_path / "executed", tmp_path / "hostile.py"
    path.write_text(HOSTILE.format(mark=str(mark), answer=answer, handler=handler))
    loading = {f"DASK_DISTRIBUTED__{who}__PRELOAD": repr([str(path)])}
    address = scheduler(loading) if who == "WORKER" else scheduler({}, **loading)
    ran = process("detect", bags, "-o", tmp_path / "out", "--cluster", address)
    assert not mark.exists()
    assert ran.returncode == 2, ran.stderr
    (line,) = ran.stderr.decode().splitlines()
    assert line.startswith(f"lidarcli: --cluster {address}: ")
    assert not (tmp_path / "out").exists()


class Reduced:
    """Whatever is pickled in this way."""

    def __init__(self, way: tuple[object, ...]) -> None:
        self.way = way

    def __reduce__(self) -> tuple[object, ...]:
        return self.way


def test_results_are_read_as_data_alone(tmp_path: Path) -> None:
    pickle_exception = pytest.importorskip("tblib.pickling_support").pickle_exception

    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "executed"),)

    summary = RunSummary(sweeps=5, topics={"/scan"}, dropped=[("/scan", "odd", 1)], outputs=["a.parquet"])
    summary.by_status["valid"] += 7
    outcomes = [Outcome("run.mcap", 3, summary, remark="again")]
    assert cluster.load_data(pickle.dumps(outcomes)) == outcomes
    found = cluster.load_data(pickle.dumps([1, "two", Evil(), {"three": Evil()}]))
    assert found[:2] == [1, "two"]
    assert isinstance(found[2], cluster.StandIn)
    assert isinstance(found[3]["three"], cluster.StandIn)
    # Errors of tasks are told apart by their names; workers pickle them by tblib.
    for error in (distributed.KilledWorker("key", None, 3), OSError(2, "gone"), ValueError("odd")):
        for sent in (error, Reduced(pickle_exception(error)), Reduced(type(error).__reduce__(error))):
            told = cluster.load_data(pickle.dumps(sent))
            assert isinstance(told, cluster.StandIn)
            assert type(told).__name__ == type(error).__name__
            assert told.args == error.args
    for code in (b"cos\nmkdir\n(S'x'\ntR.", b"(S'x'\nios\nmkdir\n.", b"cos\nmkdir\n(S'x'\nd\x81."):
        with suppress(Exception):
            cluster.load_data(code)
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    "name",
    [
        *("collections Counter", "lidarcli.pipeline.reading.one_log RunSummary"),
        *("lidarcli.pipeline.runs.over_logs Outcome", "tblib.pickling_support unpickle_exception", "os mkdir"),
    ],
)
def test_no_answer_changes_a_class_of_this_process(name: str) -> None:
    module, kind = name.split()
    # The class or function itself, and what it is asked to take for its attribute.
    state = b"(N(S'exit_code'\nS'changed'\ndtb."
    with suppress(Exception):
        cluster.load_data(f"c{module}\n{kind}\n".encode() + state)
    here = (Counter, RunSummary, Outcome, cluster.StandIn, cluster._exception, cluster._none, os.mkdir)
    assert "changed" not in [getattr(each, "exit_code", None) for each in here]


@pytest.fixture
def certificate(tmp_path: Path) -> dict[str, str]:
    """The environment of a cluster whose members show a certificate, made now."""
    key, cert = tmp_path / "key.pem", tmp_path / "cert.pem"
    private = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "cluster")])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(private.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(private, hashes.SHA256())
    )
    pem, form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    key.write_bytes(private.private_bytes(pem, form, serialization.NoEncryption()))
    cert.write_bytes(made.public_bytes(pem))
    tls = "DASK_DISTRIBUTED__COMM__TLS__"
    members = {
        f"{tls}{who}__{what}": str(file)
        for who in ("SCHEDULER", "WORKER", "CLIENT")
        for what, file in (("KEY", key), ("CERT", cert))
    }
    return {**members, f"{tls}CA_FILE": str(cert), "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "true"}


def test_tls_by_the_configuration_of_dask(
    scheduler: Callable[..., str],
    certificate: dict[str, str],
    bags: Path,
    tmp_path: Path,
    process: Callable[..., subprocess.CompletedProcess[bytes]],
) -> None:
    address = scheduler({}, protocol="tls", **certificate)
    assert address.startswith("tls://")
    known = {**os.environ, **certificate}
    shown = process("detect", bags, "-o", tmp_path / "out", "--cluster", address, env=known)
    assert shown.returncode == 0, shown.stderr
    assert len(tables(tmp_path / "out")) == 12
    stranger = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "2s"}
    without = process("detect", bags, "-o", tmp_path / "none", "--cluster", address, env=stranger)
    assert without.returncode == 2
    assert b"names no certificates for tls://" in without.stderr


def test_a_port_that_anybody_reaches_is_warned_of() -> None:
    from lidarcli.pipeline.runs.cluster import danger

    assert danger("tcp://127.0.0.1:8786") is None
    assert danger("tls://10.0.0.1:8786") is None
    assert "whoever reaches this port runs code" in (danger("tcp://10.0.0.1:8786") or "")


def test_other_workers_are_refused(
    scheduler: Callable[..., str], bags: Path, tmp_path: Path, process: Callable[..., subprocess.CompletedProcess[bytes]]
) -> None:
    address = scheduler({"LIDARCLI_COMPILED": "no"})
    ran = process("detect", bags, "-o", tmp_path / "out", "--cluster", address)
    assert ran.returncode == 2
    said = ran.stderr.decode()
    assert "workers have to be of the same build: tcp://" in said
    assert "core not compiled, here compiled" in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_the_tasks(
    bags: Path, small: bytes, tmp_path: Path, scheduler: Callable[..., str], large_log: Path
) -> None:
    address = scheduler({})
    out = tmp_path / "out"
    running = begin("detect", large_log, "-o", out, "--cluster", address, env={**os.environ})
    wait_until(lambda: [*out.glob(".lidarcli-*.part/*")], running)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=HANG)
    assert running.returncode == 130
    assert said.decode().splitlines()[-1] == "lidarcli: interrupted"
    wait_until(lambda: not [*out.glob(".lidarcli-*")])
    assert [*out.glob("*.parquet")] == []


def test_ctrl_c_ends_a_cluster_of_our_own(bags: Path, tmp_path: Path, large_log: Path) -> None:
    out = tmp_path / "out"
    running = begin("detect", large_log, "-o", out, "--cluster", "local:1", env={**os.environ})
    wait_until(lambda: [*out.glob(".lidarcli-*.part/*")], running)
    pids = descendants(running.pid)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=HANG)
    assert (running.returncode, said.decode().splitlines()[-1]) == (130, "lidarcli: interrupted")
    wait_until(lambda: gone(pids))
    assert [*out.glob("*.parquet")] == []


@pytest.fixture(scope="session")
def large_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log whose work takes some seconds."""
    from lidarcli.simulation.writers import write_log
    from tests.sweeping import room_sweeps

    path = tmp_path_factory.mktemp("large") / "long.mcap"
    sweeps = room_sweeps(count=2000)
    write_log(path, [sweeps] * 40, compression="none", chunk_size=1_000_000)
    return path


@pytest.mark.parametrize(
    ("address", "cause"),
    [
        ("local:none", "write local:N"),
        ("tcp://127.0.0.1:1", "cannot be reached"),
        ("nonsense://x:1", "write tls://HOST:PORT"),
        ("tcp://127.0.0.1", "write tls://HOST:PORT"),
        ("", "write tls://HOST:PORT"),
    ],
)
def test_an_address_that_is_none(
    address: str, cause: str, bags: Path, process: Callable[..., subprocess.CompletedProcess[bytes]]
) -> None:
    environment = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s"}
    ran = process("detect", bags, "-o", bags / "out", "--cluster", address, env=environment)
    assert ran.returncode == 2
    (line,) = ran.stderr.decode().splitlines()
    assert line.startswith(f"lidarcli: --cluster {address}: {cause}")


@pytest.mark.parametrize("arguments", [("-o", "-"), ("-o", "all.parquet"), ("-o", "out", "--jobs", "2")])
def test_what_a_cluster_is_not_for(arguments: tuple[str, ...], lidarcli: CommandLine) -> None:
    ran = lidarcli("detect", "x.mcap", *arguments, "--cluster", "local:1")
    assert ran.code == 2
    assert "--cluster" in ran.err


def test_without_the_extra_its_name_is_told(bags: Path, tmp_path: Path) -> None:
    code = "import sys; sys.modules['distributed'] = None; from lidarcli.cli import run; sys.exit(run(sys.argv[1:]))"
    ran = subprocess.run(
        [sys.executable, "-c", code, "detect", str(bags), "-o", str(tmp_path / "out"), "--cluster", "local:1"],
        capture_output=True,
        check=False,
    )
    assert ran.returncode == 2
    assert ran.stderr.decode() == (
        "lidarcli: --cluster needs distributed, which is not installed: pip install 'lidarcli[fleet]'\n"
    )


def test_who_uses_none_of_it_does_not_wait_for_it(bags: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from lidarcli.cli import run; run(sys.argv[1:]); "
        "print([name for name in ('distributed', 'lidarcli.stores.reading') if name in sys.modules])"
    )
    command = [sys.executable, "-c", code, "detect", str(bags / "one.mcap"), "-o", str(tmp_path / "out")]
    ran = subprocess.run(command, capture_output=True, check=True)
    assert ran.stdout.decode() == "[]\n"


def test_standard_input_is_for_no_cluster(lidarcli: CommandLine, tmp_path: Path) -> None:
    ran = lidarcli("detect", "-", "-o", tmp_path / "out", "--cluster", "local:1")
    assert ran.code == 2
    assert "reads no standard input" in ran.err


def test_an_address_with_credentials_is_not_repeated(bags: Path, lidarcli: CommandLine, tmp_path: Path) -> None:
    ran = lidarcli("detect", bags, "-o", tmp_path / "out", "--cluster", "tcp://user:SECRET@host:1")
    assert ran.code == 2
    assert "SECRET" not in ran.err


def test_ctrl_c_of_a_terminal_reaches_the_workers_too(tmp_path: Path, large_log: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "lidarcli", "detect", str(large_log), "-o", str(out), "--cluster", "local:2"]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, start_new_session=True)
    wait_until(lambda: [*out.glob(".lidarcli-*.part/*")], running)
    os.killpg(running.pid, signal.SIGINT)
    _, said = running.communicate(timeout=HANG)
    lines = [line for line in said.decode().splitlines() if not line.startswith("cluster ")]
    assert (running.returncode, lines) == (130, ["lidarcli: interrupted"])
    assert [*out.glob("**/*.parquet")] == []
    assert [*out.glob(".lidarcli-*")] == []


def test_what_is_compared_with_a_background_is_sent_along(tmp_path: Path, lidarcli: CommandLine) -> None:
    background = tmp_path / "empty.background.parquet"
    assert lidarcli("background", "build", SAMPLES / "room_empty.mcap", "-o", background).code == 0
    command = ("detect", SAMPLES / "room.mcap", "--background", background)
    assert lidarcli(*command, "-o", tmp_path / "here").code == 0
    assert lidarcli(*command, "-o", tmp_path / "there", "--cluster", "local:1").code == 0
    assert tables(tmp_path / "there") == tables(tmp_path / "here")


def test_tables_that_only_a_worker_has_end_the_run(tmp_path: Path) -> None:
    elsewhere = Outcome("run.mcap", 0, RunSummary(outputs=[str(tmp_path / "run.objects.parquet")]))
    with pytest.raises(OutputError, match="a worker has written it, and it is not here"):
        refuse_elsewhere(elsewhere)
    refuse_elsewhere(Outcome("run.mcap", 0, RunSummary(outputs=["s3://robots/run.objects.parquet"])))
    refuse_elsewhere(Outcome("run.mcap", 3, error="cut off"))
