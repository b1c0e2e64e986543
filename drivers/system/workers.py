"""Worker processes that end with the one that started them: at its Ctrl-C, its errors and its death."""

import contextlib
import ctypes
import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

PR_SET_PDEATHSIG = 1
END_S = 0.5
"""How long a worker may take to end before it is killed."""


@contextlib.contextmanager
def worker_pool(
    processes: int, initializer: Callable[..., object] | None = None, initargs: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """A pool of spawned processes. Left by an exception, Ctrl-C too, it ends them at once instead of waiting.

    The workers ignore SIGINT from their first instruction on: a terminal sends it to all, the parent decides.
    """
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, context, _start, (initializer, initargs))
    try:
        with _deaf_to_interrupts():
            for _ in range(processes):
                pool.submit(_nothing)  # each starts one, as none is idle yet
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        end_processes([p for p in multiprocessing.active_children() if p not in before])
        raise
    pool.shutdown()


def end_processes(processes: "list[Any]") -> None:
    """End processes: those that do not at once are killed."""
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(END_S)
        if process.is_alive():
            process.kill()
            process.join(END_S)


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """SIGINT is ignored, and so it is by what is started meanwhile, for good."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


def _start(initializer: Callable[..., object] | None, initargs: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(
        OSError, AttributeError
    ):  # Linux alone: a parent that is killed takes them along
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if initializer is not None:
        initializer(*initargs)


def _nothing() -> None:
    return
