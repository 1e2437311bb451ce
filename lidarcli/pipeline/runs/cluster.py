"""Many logs on the workers of a Dask cluster: whole logs are the unit, and no loss of a worker costs a result.

The scheduler keeps all results that nobody has fetched, and counts the death of a worker against every task that waits on
it. Hence only a window of logs is submitted at a time, results are small, fetched and let go at once, and a log that seems
to kill workers is tried once more alone before that is said of it.

Pickles of a cluster are read as data: numbers, texts and lists of them, and nothing that could run. Whoever answers at the
address of a scheduler says what its pickles call when they are read. Here they call nothing: a class that is not one of a
few of our own stands for its name and its values alone.
"""

from __future__ import annotations

import io
import json
import logging
import os
import pickle
import queue
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from hashlib import blake2b
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

from lidarcli import compiled
from lidarcli._version import __version__
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.machine import keep_freed_memory
from lidarcli.newfiles import scratch_folder
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs.outcomes import INTERNAL_ERROR, Outcome, Work, outcome_of
from lidarcli.pipeline.runs.processes import signals_held
from lidarcli.stores.url import absolute, is_url

try:
    import dask
    import distributed
except ImportError as err:
    raise OptionError("--cluster needs distributed, which is not installed: pip install 'lidarcli[fleet]'") from err

LOCAL = "local"
"""`local:N` starts N workers on this machine."""
WINDOW = 2
"""Tasks that are submitted at a time for each thread of the cluster: one at work, one waiting."""
TOGETHER, TOGETHER_BYTES = 16, 8 << 20
"""Most logs of one task, and their bytes: a task takes the scheduler some milliseconds, as a small log takes a worker."""
HERE = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.log-length": 100,
    "distributed.admin.low-level-log-length": 100,
}
"""Settings of a cluster of our own: its profiles and logs are not used, and take time and memory."""
NO_WORKER_S = 120.0
"""Time without a worker after which a cluster is given up [s]."""
FIRST_WORKER_S = 30.0
STARTS = 3
"""Attempts to start a cluster of our own: a worker may be killed while it starts, as where memory is short."""
CONNECT_S = 10.0
UNWIND_S = 5.0
"""Time for logs at work to remove their unfinished files before their workers are ended [s]."""
LOOK_S = 5.0
"""Time between looks at the size of the cluster [s]."""
LOST_TIMES = 3
"""Times that a task is submitted again which the cluster has lost, as by a restart."""


class _Stopped(BaseException):
    """The run no longer needs this log: unwinds through the writers, which remove their unfinished files."""


class _OtherBuildError(Exception):
    """A worker that joined later would write other bytes."""


class _Setup(distributed.WorkerPlugin):
    """Setup of every worker, sent once: the work, with all its options, and the build that is required."""

    def __init__(self, name: str, work: Work, told: dict[str, str]) -> None:
        self.name = name
        self.work = work
        self.told = told

    def setup(self, worker: Any) -> None:
        """Nannies make the allocator give back all that is freed, which takes a tenth of the time."""
        keep_freed_memory()


class Cluster:
    """A Dask cluster that was there, or one of our own on this machine; leaving ends what is ours.

    Parameters
    ----------
    address : of the scheduler (`tcp://HOST:PORT`, `tls://HOST:PORT`), or `local:N`

    Raises
    ------
    OptionError
        No such cluster, no worker, or workers with another lidarcli, Python or core.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._stack = ExitStack()
        self._client: Any = None
        self._own: Any = None
        """The cluster of `local:N`."""
        self._threads = 1
        self._looked = 0.0
        self._alone_since: float | None = None

    def __enter__(self) -> Self:
        try:
            self._connect()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self._stack.close()

    @property
    def is_local(self) -> bool:
        """True for a cluster of our own on this machine."""
        return self._address.partition(":")[0] == LOCAL

    @property
    def about(self) -> str:
        """Its address and its size."""
        count = len(self._workers())
        workers = f"{count} worker{'' if count == 1 else 's'}, {self._threads} thread{'' if self._threads == 1 else 's'}"
        return f"{self._client.scheduler.address}: {workers}"

    @property
    def warning(self) -> str | None:
        """Danger of this cluster; None where there is none."""
        return danger(self._client.scheduler.address)

    def outcomes(self, sources: Sequence[Source | MissingInput], work: Work) -> Iterator[Outcome]:
        """Do `work` for each of `sources`, and yield the outcomes in the order in which they end.

        Raises
        ------
        OptionError
            A worker that joined meanwhile has another build, or there are no workers any more.
        """
        name = f"lidarcli-{os.urandom(8).hex()}"
        self._client.register_plugin(_Setup(name, work, build()), name=name)
        try:
            yield from _Submitting(self, sources, name).outcomes()
        finally:
            with suppress(Exception):
                self._client.unregister_worker_plugin(name)

    def submit(self, sources: tuple[Source | MissingInput, ...], name: str) -> Any:
        """Submit some logs to the next free worker."""
        sent = tuple(map(_sent, sources))
        return self._client.submit(_do, name, sent, pure=False, key=f"{name}-{os.urandom(8).hex()}")

    def cancel(self, futures: list[Any]) -> None:
        """Cancel logs that are no longer needed, also those at work."""
        with suppress(Exception):
            self._client.cancel(futures, force=True)
            # Workers of our own are ended soon, and should not be in the middle of a file then.
            until = time.monotonic() + UNWIND_S if self.is_local else 0.0
            while time.monotonic() < until and any(self._client.run(_by_value(_at_work)).values()):
                time.sleep(0.05)

    def window(self) -> int:
        """Return the number of tasks that may be submitted at a time."""
        now = time.monotonic()
        if now - self._looked > LOOK_S:
            self._looked = now
            workers = self._workers()
            self._replace_lost(len(workers))
            if workers:
                self._alone_since = None
                self._threads = max(1, sum(workers.values()))
            elif self._alone_since is None:
                self._alone_since = now
            elif now - self._alone_since > NO_WORKER_S:
                raise OptionError(
                    f"--cluster {self._address}: has had no worker for {NO_WORKER_S:.0f} s; start some, then run again "
                    "with --resume"
                )
        return WINDOW * self._threads

    def _replace_lost(self, count: int) -> None:
        """Start new workers of our own for those that ended while they started, which their nannies then give up."""
        if self._own is None or count >= len(self._own.worker_spec):
            return
        for name, nanny in [*self._own.workers.items()]:
            if nanny.status in (distributed.Status.closed, distributed.Status.failed):
                self._own.workers.pop(name, None)
        self._own.scale(len(self._own.worker_spec))

    def refuse_other_builds(self) -> None:
        """Refuse workers whose tables could have other bytes than ours."""
        try:
            told = self._client.run(_by_value(_told), on_error="return")
        except Exception as err:
            raise OptionError(f"--cluster {self._address}: cannot be asked: {_words(err)}") from err
        mine = build()
        others = []
        for worker, text in sorted(told.items()):
            theirs = _parsed(text)
            others += [
                f"{worker}: {what} {theirs[what]}, here {mine[what]}"
                for what in mine
                if what in theirs and theirs[what] != mine[what]
            ]
        if others:
            raise OptionError(f"--cluster {self._address}: workers have to be of the same build: {'; '.join(others)}")

    def _connect(self) -> None:
        kind, _, number = self._address.partition(":")
        # The scheduler and the nannies say on stderr what is said by outcomes.
        for logger in ("distributed", "tornado", "asyncio"):
            logging.getLogger(logger).setLevel(logging.CRITICAL)
        if kind == LOCAL:
            self._client = self._local(number)
        else:
            refuse_address(self._address)
            self._stack.enter_context(_nothing_run())
            try:
                self._client = self._stack.enter_context(
                    distributed.Client(self._address, set_as_default=False, timeout=CONNECT_S)
                )
            except Exception as err:
                # The program that answers there may be any.
                raise OptionError(f"--cluster {self._address}: cannot be reached: {_words(err)}") from err
        try:
            self._client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError as err:
            raise OptionError(f"--cluster {self._address}: has no worker; start some first") from err
        except Exception as err:
            raise OptionError(f"--cluster {self._address}: cannot be asked: {_words(err)}") from err
        self.refuse_other_builds()
        self.window()

    def _local(self, number: str) -> Any:
        if not number.isdecimal() or not 0 < int(number) <= 1024:
            raise OptionError(f"--cluster {self._address}: write local:N with N workers")
        folder = str(self._stack.enter_context(scratch_folder()))
        self._stack.enter_context(dask.config.set(HERE))
        for _ in range(STARTS):
            with suppress(RuntimeError, OSError):
                return self._started(int(number), folder)
        raise OptionError(
            f"--cluster {self._address}: a worker ended while it started, {STARTS} times (out of memory?); take fewer "
            "workers, or --jobs in their place"
        )

    def _started(self, count: int, folder: str) -> Any:
        """Start workers and return a client of them."""
        # Ctrl-C is for this process, which ends the workers.
        with signals_held():
            self._own = self._stack.enter_context(
                distributed.LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    processes=True,
                    # It is not used.
                    dashboard_address=None,
                    local_directory=folder,
                    silence_logs=logging.CRITICAL,
                )
            )
        return self._stack.enter_context(distributed.Client(self._own, set_as_default=False))

    def _workers(self) -> dict[str, int]:
        """Worker → its threads."""
        try:
            found = self._client.nthreads()
            return {str(worker): int(threads) for worker, threads in found.items()}
        except Exception as err:
            raise OptionError(f"--cluster {self._address}: cannot be asked: {_words(err)}") from err


def refuse_address(address: str) -> None:
    """Refuse a wrong address of a scheduler: its client would wait for a minute, and print more than one line.

    Raises
    ------
    OptionError
        It is none, or holds credentials, which are not repeated in the message.
    """
    url = urlsplit(address)
    try:
        port = url.port
    except ValueError:
        port = None
    if "@" in url.netloc:
        raise OptionError("--cluster: an address holds no credentials; tls:// takes certificates (docs/fleet.md)")
    if url.scheme not in ("tcp", "tls") or not url.hostname or not port:
        raise OptionError(f"--cluster {address}: write tls://HOST:PORT, tcp://HOST:PORT or local:N")
    if url.scheme == "tls" and distributed.Security().get_connection_args("client").get("ssl_context") is None:
        raise OptionError(f"--cluster {address}: Dask's configuration names no certificates for tls:// (docs/fleet.md)")


def danger(address: str) -> str | None:
    """Return the danger of a scheduler at an address; None where there is none."""
    url = urlsplit(address)
    if url.scheme != "tcp" or url.hostname in ("127.0.0.1", "::1", "localhost"):
        return None
    return (
        f"{address} is neither encrypted nor asks who connects: whoever reaches this port runs code on the workers; "
        "tls:// does both (docs/fleet.md)"
    )


@dataclass(frozen=True, slots=True)
class _Task:
    """Logs that are submitted together: one, or several small ones."""

    sources: tuple[Source | MissingInput, ...]
    lost: int = 0
    """Times that the cluster has lost it."""
    alone: bool = False
    """True where nothing else is submitted beside it."""


class _Submitting:
    """One run over a cluster: logs that wait, tasks that were submitted, and logs that seem to kill workers."""

    def __init__(self, cluster: Cluster, sources: Sequence[Source | MissingInput], name: str) -> None:
        self._cluster = cluster
        self._name = name
        self._waiting = deque(sources)
        self._suspects: deque[Source | MissingInput] = deque()
        self._running: dict[Any, _Task] = {}
        """Future → its task."""
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def outcomes(self) -> Iterator[Outcome]:
        """See `Cluster.outcomes`."""
        try:
            while self._waiting or self._running or self._suspects:
                self._fill()
                try:
                    future = self._ended.get(timeout=LOOK_S)
                except queue.Empty:
                    continue
                yield from self._take(future)
        except BaseException:
            self._cluster.cancel([*self._running])
            raise

    def _fill(self) -> None:
        window = self._cluster.window()
        while self._waiting and len(self._running) < window:
            self._submit(_Task(self._next(window)))
        if not self._running and self._suspects:
            self._submit(_Task((self._suspects.popleft(),), alone=True))

    def _next(self, window: int) -> tuple[Source | MissingInput, ...]:
        """Take the next logs for one task, fewer towards the end, so that all workers end at the same time."""
        most = min(TOGETHER, len(self._waiting) // (2 * window))
        found = [self._waiting.popleft()]
        size = _size(found[0])
        while len(found) < most and (size := size + _size(self._waiting[0])) <= TOGETHER_BYTES:
            found.append(self._waiting.popleft())
        return tuple(found)

    def _submit(self, task: _Task) -> None:
        future = self._cluster.submit(task.sources, self._name)
        self._running[future] = task
        future.add_done_callback(self._ended.put)

    def _take(self, future: Any) -> list[Outcome]:
        """Return the outcomes of a task that has ended; none where its logs have to be done again."""
        task = self._running.pop(future)
        status = future.status
        if status == "finished":
            outcomes: list[Outcome] = future.result()
            future.release()
            return [
                replace(outcome, label=source.label, source=source)
                for source, outcome in zip(task.sources, outcomes, strict=True)
            ]
        error = future.exception() if status == "error" else None
        future.release()
        # By their names, as errors of a cluster elsewhere are not made (`load_data`).
        kind = type(error).__name__
        if kind == distributed.KilledWorker.__name__:
            if not task.alone:
                self._suspects += task.sources
                return []
            words = "ends every worker that reads it (out of memory?); try it alone, without --cluster"
            return _failed(task, UnreadableError.exit_code, words)
        if kind == _OtherBuildError.__name__:
            self._cluster.refuse_other_builds()
            raise OptionError(f"--cluster: {error}")
        if error is not None:
            words = f"internal error on a worker: {kind}: {error}"
            return _failed(task, INTERNAL_ERROR, words)
        if task.lost >= LOST_TIMES:
            return _failed(task, INTERNAL_ERROR, f"the cluster lost it {task.lost + 1} times")
        self._submit(replace(task, lost=task.lost + 1))
        return []


def _failed(task: _Task, code: int, error: str) -> list[Outcome]:
    return [Outcome(source.label, code, error=error, source=source) for source in task.sources]


def _size(source: Source | MissingInput) -> int:
    """Return the bytes of a log; of an unknown size enough for a task."""
    return 0 if isinstance(source, MissingInput) else source.size or TOGETHER_BYTES


def _sent(source: Source | MissingInput) -> Source | MissingInput:
    """Return a log for a worker, whose working directory is another."""
    return source if isinstance(source, MissingInput) else _absolute(source)


def _absolute(source: Source) -> Source:
    if is_url(source.path) and not source.parts:
        return source
    return replace(
        source,
        path=absolute(source.path),
        files=tuple(map(absolute, source.files)),
        parts=tuple(map(_absolute, source.parts)),
    )


def _do(name: str, sources: tuple[Source | MissingInput, ...]) -> list[Outcome]:
    """Do some logs, on a worker."""
    worker: Any = distributed.get_worker()
    key, setup = worker.get_current_task(), worker.plugins[name]
    if setup.told != build():
        raise _OtherBuildError(f"{worker.address} has another build")

    def watch(position: int) -> None:
        state = worker.state.tasks.get(key)
        if state is None or state.state == "cancelled":
            raise _Stopped

    def work(source: Source) -> RunSummary:
        watch(0)
        done: RunSummary = setup.work(source, progress=watch)
        return done

    return [replace(outcome_of(source, work), source=None) for source in sources]


def _told() -> str:
    """Return the build of a worker as JSON; runs there, where lidarcli may not be installed."""
    import json

    try:
        from lidarcli.pipeline.runs.cluster import build
    except ImportError as err:
        return json.dumps({"lidarcli": f"cannot be imported ({err})"})
    return json.dumps(build())


def _parsed(answer: object) -> dict[str, str]:
    """Return the build of an answer of `_told`; any other answer is told as the build."""
    try:
        found = json.loads(answer) if isinstance(answer, str) else None
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or "lidarcli" not in found:
        return {"lidarcli": f"cannot be asked ({type(answer).__name__}: {answer})"}
    return {str(what): str(value) for what, value in found.items()}


@contextmanager
def _nothing_run() -> Iterator[None]:
    """Read answers of a cluster elsewhere as data alone, wherever distributed reads a pickle in this process."""
    from distributed import client
    from distributed.protocol import pickle as pickles

    read = SimpleNamespace(**{**vars(pickle), "loads": load_data})
    places = [(pickles, "loads", load_data), (client, "loads", load_data), (client, "pickle", read)]
    before = [getattr(module, name) for module, name, _ in places]
    try:
        for module, name, value in places:
            setattr(module, name, value)
        yield
    finally:
        for (module, name, _), value in zip(places, before, strict=True):
            setattr(module, name, value)


def _words(err: Exception) -> str:
    """Return an error as one line."""
    return str(err).splitlines()[0] if str(err) else type(err).__name__


def _at_work(dask_worker: Any) -> int:
    """Return the number of tasks that a worker is busy with."""
    return len(dask_worker.active_threads)


def _by_value(function: Callable[..., Any]) -> Callable[..., Any]:
    """Mark a function to be sent by value: a worker without lidarcli could not look up its name."""
    function.__module__ = "__main__"
    return function


@cache
def build() -> dict[str, str]:
    """Return everything that bytes of tables may depend on beside the log and the parameters."""
    import numpy as np
    import pyarrow as pa

    package = Path(compiled.__file__).parent
    digest = blake2b(digest_size=4)
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return {
        "lidarcli": f"{__version__} ({digest.hexdigest()})",
        "Python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "core": "compiled" if compiled.is_wanted() and compiled.is_there() else "not compiled",
        "numpy": np.__version__,
        "pyarrow": pa.__version__,
    }


_KNOWN = {(kind.__module__, kind.__name__): kind for kind in (Outcome, RunSummary)}
"""Classes of results. Each has a `__setstate__`: without one a pickle could set attributes of the class itself."""


class StandIn(Exception):  # noqa: N818 (it stands for any class of its name)
    """Stands for an object of a class that is not made: keeps its name and its values."""

    def __new__(cls, *values: Any, **named: Any) -> StandIn:
        """Accept any values."""
        return super().__new__(cls, *values)

    def __init__(self, *values: Any, **named: Any) -> None:
        super().__init__(*values)

    def __setstate__(self, state: Any) -> None:
        """Set nothing."""


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str, /) -> Any:
        """Return a class of results, or a class of stand-ins; shared callables get a new object, which may be changed."""
        if (module, name) == ("collections", "Counter"):
            return partial(Counter)
        if module == "tblib.pickling_support":
            # Workers pickle exceptions and tracebacks by it; None does in the place of a traceback.
            return partial(_exception if name.startswith("unpickle_exception") else _none)
        return _KNOWN.get((module, name)) or type(name, (StandIn,), {})


def load_data(data: Any, *, buffers: Iterable[Any] = ()) -> Any:
    """Read a pickle as data; distributed calls it in the place of its own reader."""
    return _Reader(io.BytesIO(data), buffers=buffers).load()


def _exception(kind: Any, values: Any, *more: Any) -> StandIn:
    """Return a stand-in for an exception of this kind; its words are values or among its attributes."""
    words = values.get("args") if isinstance(values, dict) else values
    is_kind = isinstance(kind, type) and issubclass(kind, StandIn)
    return (kind if is_kind else StandIn)(*(words if isinstance(words, tuple) else ()))


def _none(*values: Any) -> None:
    """Return None."""
