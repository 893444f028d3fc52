"""Many jobs that do not need each other: here, in processes, or on a Dask cluster that is there."""

import copyreg
import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context, parent_process
from types import MappingProxyType
from typing import Any, TypeVar

_Task = TypeVar("_Task")
_Found = TypeVar("_Found")
_ANSWER_S = 10.0
"""How long a Dask scheduler may take to answer [s]."""


def read_only_again(found: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    """Return a mapping read-only, as it was in the process that it came from."""
    return MappingProxyType(found)


# Results hold read-only mappings, which have no way of their own to another process, nor has their
# class a name that pickle finds.
copyreg.pickle(MappingProxyType, lambda found: (read_only_again, (dict(found),)))


@dataclass(frozen=True)
class Workers:
    """Who does the jobs."""

    processes: int = 1
    """How many processes of this machine; 1 for this one alone."""
    dask: str | None = None
    """Address of a Dask scheduler, `tcp://host:8786`; its workers see the same folders."""

    def map(
        self,
        job: Callable[[_Task], _Found],
        tasks: Sequence[_Task],
        progress: Callable[[int, int], None] | None = None,
    ) -> list[_Found]:
        """Do a job for each task.

        Args:
            job: A function of a module, which does not know who calls it.
            tasks: What it is called with.
            progress: Called with jobs done and jobs in all.

        Returns:
            What it returned, in the order of the tasks, whoever did them.

        Raises:
            Exception: What a job raised; the others end then.
            ConnectionError: If no Dask scheduler answers.
            ChildProcessError: If a process was killed, as one is when memory runs out.
            ValueError: If Dask is not installed.
        """
        tell = progress or (lambda done, total: None)
        tell(0, len(tasks))
        if self.dask is None and (self.processes == 1 or len(tasks) < 2):
            found = []
            for task in tasks:
                found.append(job(task))
                tell(len(found), len(tasks))
            return found
        if self.dask is None:
            with _processes(min(self.processes, len(tasks))) as executor:
                futures = [executor.submit(job, task) for task in tasks]
                return _gathered(futures, as_completed(futures), tell)
        with _cluster(self.dask) as client:
            from distributed import as_completed as as_completed_there

            futures = client.map(job, tasks, pure=False)
            return _gathered(futures, as_completed_there(futures, loop=client.loop), tell)


def _gathered(futures: list[Any], finished: Iterator[Any], tell: Callable[..., None]) -> list[Any]:
    for done, one in enumerate(finished, start=1):
        one.result()  # an error ends all at once, not when the longest job is done
        tell(done, len(futures))
    return [future.result() for future in futures]


@contextmanager
def _processes(count: int) -> Iterator[Executor]:
    """Give fresh processes: a fork would carry over Drake's servers and renderers."""
    others = active_children()
    executor = ProcessPoolExecutor(count, get_context("spawn"), initializer=_end_with_parent)
    try:
        yield executor
    except BrokenProcessPool as error:
        raise ChildProcessError(
            "a process was killed before its job was done, as when memory runs out: take fewer "
            "--processes"
        ) from error
    except BaseException:
        for child in active_children():
            if child not in others:
                child.terminate()
        raise
    finally:
        executor.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Let this process end when the one that asks for its results does, and leave Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None, "a spawned process has one"

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError(
            "Dask is not installed: pip install 'nico-selfmodel[dask]', or take --processes"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConnectionError(
            f"no Dask scheduler answers at {address}: start one (`dask scheduler`, and `dask "
            f"worker {address}`), or take --processes"
        ) from error
    try:
        yield client
    finally:
        client.close()
