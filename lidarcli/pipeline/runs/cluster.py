"""Many logs on the workers of a Dask cluster: whole logs are the unit, and no loss of a worker costs a result.

The scheduler counts the death of a worker against every task that waits on it. Hence only a few logs are submitted at a
time, and a log that seems to kill workers is tried once more alone before it is reported.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from asyncio import CancelledError
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from lidarcli._version import __version__
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.files.newfiles import scratch_folder
from lidarcli.files.stores import absolute, is_url
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs.over_logs import INTERNAL_ERROR, LogWork, Outcome, outcome_of
from lidarcli.pipeline.runs.processes import signals_held
from lidarcli.system import compiled
from lidarcli.system.machine import keep_freed_memory

try:
    import dask
    import distributed
except ImportError as err:
    raise OptionError("--cluster needs distributed, which is not installed: pip install 'lidarcli[fleet]'") from err

MAX_WORKERS = 1024
WINDOW = 2
"""Logs that are submitted at a time for each thread of the cluster: one at work, one waiting."""
OWN_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.log-length": 100,
    "distributed.admin.low-level-log-length": 100,
    "distributed.scheduler.no-workers-timeout": "120s",
}
"""Settings of a cluster of our own: its profiles and logs are not used, and take time and memory."""
CONNECT_S, FIRST_WORKER_S = 10.0, 30.0
UNWIND_S = 60.0
"""Longest time for logs at work to remove their unfinished files [s]: a thread that waits for a pipe ends for nobody."""
LOOK_S = 5.0
"""Time between looks at the size of the cluster [s]."""


class _Stopped(BaseException):
    """The run no longer needs this log: unwinds through the writers, which remove their unfinished files."""


class _Setup(distributed.WorkerPlugin):
    """Setup of every worker, sent once: the work, with all its options, and the build that is required."""

    def __init__(self, name: str, work: LogWork) -> None:
        self.name = name
        self.work = work
        self.build = build()

    def setup(self, worker: Any) -> None:
        """Keep freed memory: nannies make the allocator give all of it back, which takes a tenth of the time."""
        keep_freed_memory()


@contextmanager
def connected(address: str) -> Iterator[distributed.Client]:
    """Connect to a cluster that is there (`tcp://HOST:PORT`, `tls://HOST:PORT`), or start one of our own (`local:N`).

    Raises
    ------
    OptionError
        No such cluster, no worker, or workers with another lidarcli, Python or core.
    """
    # The scheduler and the nannies say on stderr what is said by outcomes.
    for logger in ("distributed", "tornado", "asyncio"):
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        try:
            is_own = address.partition(":")[0] == "local"
            target = _local(address, stack) if is_own else _known(address)
            client = stack.enter_context(distributed.Client(target, set_as_default=False, timeout=CONNECT_S))
        except (OSError, RuntimeError) as err:
            raise OptionError(f"--cluster {address}: cannot be reached: {err}") from err
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
            builds = client.run(build)
        except TimeoutError as err:
            raise OptionError(f"--cluster {address}: has no worker; start some first") from err
        except Exception as err:
            # Workers may be anything, also without lidarcli.
            raise OptionError(f"--cluster {address}: cannot be asked: {err}") from err
        others = [
            f"{worker}: {what} {found.get(what)}, here {here}"
            for worker, found in sorted(builds.items())
            for what, here in build().items()
            if found.get(what) != here
        ]
        if others:
            raise OptionError(f"--cluster {address}: workers have to be of the same build: {'; '.join(others)}")
        yield client


def _local(address: str, stack: ExitStack) -> Any:
    number = address.partition(":")[2]
    if not number.isdecimal() or not 0 < int(number) <= MAX_WORKERS:
        raise OptionError(f"--cluster {address}: write local:N with N workers")
    stack.enter_context(dask.config.set(OWN_SETTINGS))
    # Ctrl-C is for this process, which ends the workers.
    with signals_held():
        return stack.enter_context(
            distributed.LocalCluster(
                n_workers=int(number),
                threads_per_worker=1,
                processes=True,
                dashboard_address=":0",
                local_directory=str(stack.enter_context(scratch_folder())),
                silence_logs=logging.CRITICAL,
            )
        )


def _known(address: str) -> str:
    """Return the address of a scheduler; refuse a wrong one, for which a client would wait for a minute."""
    url = urlsplit(address)
    if "@" in url.netloc:
        raise OptionError("--cluster: an address holds no credentials; tls:// takes certificates (docs/fleet.md)")
    try:
        is_known = url.scheme in ("tcp", "tls") and bool(url.hostname and url.port)
    except ValueError:
        is_known = False
    if not is_known:
        raise OptionError(f"--cluster {address}: write tls://HOST:PORT, tcp://HOST:PORT or local:N")
    if url.scheme == "tls" and distributed.Security().get_connection_args("client").get("ssl_context") is None:
        raise OptionError(f"--cluster {address}: Dask's configuration names no certificates for tls:// (docs/fleet.md)")
    return address


def size_of(client: Any) -> tuple[str, int, int]:
    """Return the address of a cluster's scheduler, and the numbers of its workers and of their threads."""
    threads = client.nthreads()
    return str(client.scheduler.address), len(threads), sum(threads.values())


def danger(address: str) -> str | None:
    """Return the danger of a scheduler at an address; None where there is none."""
    url = urlsplit(address)
    if url.scheme != "tcp" or url.hostname in ("127.0.0.1", "::1", "localhost"):
        return None
    return (
        f"{address} is neither encrypted nor asks who connects: whoever reaches this port runs code on the workers; "
        "tls:// does both (docs/fleet.md)"
    )


def outcomes(client: distributed.Client, sources: Sequence[Source | MissingInput], work: LogWork) -> Iterator[Outcome]:
    """Do `work` for each of `sources`, and yield the outcomes in the order in which they end."""
    name = f"lidarcli-{os.urandom(8).hex()}"
    client.register_plugin(_Setup(name, work), name=name)
    waiting, suspects = deque(sources), deque[Source | MissingInput]()
    running: dict[Any, Source | MissingInput] = {}
    ended = distributed.as_completed(loop=client.loop)
    looked, window = -LOOK_S, 1
    try:
        while waiting or running or suspects:
            if time.monotonic() - looked > LOOK_S:
                looked = time.monotonic()
                # A scheduler that is busy is tried again later.
                with suppress(OSError, TimeoutError):
                    window = WINDOW * max(1, size_of(client)[2])
            is_alone = not waiting and not running
            while (waiting and len(running) < window) or (is_alone and not running):
                source = waiting.popleft() if waiting else suspects.popleft()
                key = f"{name}-{os.urandom(8).hex()}"
                future = client.submit(_do, name, _sent(source), pure=False, key=key)
                running[future] = source
                ended.add(future)
            future = next(ended)
            source = running.pop(future)
            outcome = _outcome(future, source, is_alone)
            if outcome is None:
                suspects.append(source)
            else:
                yield outcome
    except BaseException:
        _cancel(client, [*running])
        raise
    finally:
        with suppress(Exception):
            client.unregister_worker_plugin(name)


def _outcome(future: Any, source: Source | MissingInput, is_alone: bool) -> Outcome | None:
    """Return the outcome of a log; None for one that seems to kill workers and was not alone."""
    code = INTERNAL_ERROR
    try:
        outcome: Outcome = future.result()
        return replace(outcome, label=source.label, source=source)
    except (distributed.KilledWorker, CancelledError):
        # The cluster may also have lost it.
        if not is_alone:
            return None
        code = UnreadableError.exit_code
        error = "ends every worker that reads it (out of memory?); try it alone, without --cluster"
    except Exception as err:
        error = f"internal error on a worker: {type(err).__name__}: {err}"
    finally:
        future.release()
    return Outcome(source.label, code, error=error, source=source)


def _cancel(client: distributed.Client, futures: list[Any]) -> None:
    """Cancel logs that are no longer needed; workers of our own are ended soon, and get the time to tidy up."""
    with suppress(Exception):
        client.cancel(futures, force=True)
        until = time.monotonic() + (UNWIND_S if client.cluster is not None else 0.0)
        while time.monotonic() < until and any(client.run(lambda dask_worker: len(dask_worker.active_threads)).values()):
            time.sleep(0.05)


def _sent(source: Source | MissingInput) -> Source | MissingInput:
    """Return a log for a worker, whose working directory is another."""
    if isinstance(source, MissingInput) or (is_url(source.path) and not source.parts):
        return source
    parts = tuple(part for each in source.parts if isinstance(part := _sent(each), Source))
    return replace(source, path=absolute(source.path), files=tuple(map(absolute, source.files)), parts=parts)


def _do(name: str, source: Source | MissingInput) -> Outcome:
    """Do one log, on a worker."""
    worker: Any = distributed.get_worker()
    key, setup = worker.get_current_task(), worker.plugins[name]
    if setup.build != build():
        raise RuntimeError(f"{worker.address} joined the cluster with another build")

    def watch(position: int) -> None:
        state = worker.state.tasks.get(key)
        if state is None or state.state == "cancelled":
            raise _Stopped

    def work(source: Source) -> RunSummary:
        watch(0)
        done: RunSummary = setup.work(source, progress=watch)
        return done

    return replace(outcome_of(source, work), source=None)


@cache
def build() -> dict[str, str]:
    """Return everything that bytes of tables may depend on in addition to the log and the parameters."""
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
