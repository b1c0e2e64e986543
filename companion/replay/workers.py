"""Many flights at a time: on processes of this machine or on Dask's workers, with progress on a terminal."""

import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from companion.replay.many import Result, replay_many, replay_one
from companion.replay.replay import ReplayJob
from drivers.system.pools import Pool, dask, processes

AHEAD = 4
"""Flights handed to each process in advance."""
BARS = 16
"""So many flights have a bar each; more of them share one."""

_reports: Any = None
"""In a worker process: the queue to the one that draws the progress."""


def _start_worker(queue: Any) -> None:
    global _reports
    _reports = queue


def _work(job: ReplayJob) -> Result:
    return replay_one(job, lambda done, total: _reports.put((job.name, done, total)))


def in_parallel(
    jobs: Sequence[ReplayJob], processes_wanted: int | None, address: str | None
) -> Iterator[tuple[ReplayJob, Result]]:
    """Every flight as it ends, with bars on a terminal.

    ``processes_wanted`` of this machine (None: one a processor), or the workers of the Dask scheduler at ``address``.
    """
    workers = min(max(len(jobs), 1), processes_wanted or os.cpu_count() or 1)
    work: Callable[[ReplayJob], Result] = replay_one
    with ExitStack() as stack:
        if address is not None:
            pool, ahead = dask(address), AHEAD * (processes_wanted or len(jobs))
            one = stack.enter_context(_one_bar(len(jobs)))
        elif len(jobs) > BARS:
            pool, ahead = processes(workers), AHEAD * workers
            one = stack.enter_context(_one_bar(len(jobs)))
        else:
            bars = stack.enter_context(progress_bars(jobs))
            pool = stack.enter_context(_reporting(workers, {job.name: bars(job) for job in jobs}))
            work, ahead, one = _work, AHEAD * workers, lambda failed: None
        for job, result in replay_many(jobs, pool, ahead, work):
            one(result.failed)
            yield job, result


@contextmanager
def _reporting(workers: int, updates: dict[str, Any]) -> Iterator[Pool]:
    """Processes of this machine that report the frames they have done."""
    with multiprocessing.get_context("spawn").Manager() as manager:
        queue = manager.Queue()

        def show() -> None:
            with suppress(EOFError, OSError):  # Ctrl-C: the queue is gone
                for name, done, total in iter(queue.get, None):
                    updates[name](done, total)

        thread = threading.Thread(target=show, daemon=True)
        thread.start()
        yield processes(workers, _start_worker, queue)
        queue.put(None)
        thread.join()


@contextmanager
def _one_bar(total: int) -> Iterator[Any]:
    """A function that is called at the end of every flight: one bar for all, with the rate, on a terminal."""
    if not sys.stderr.isatty():
        yield lambda failed: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    text = "flights, {task.fields[rate]:.2f} a second, {task.fields[failures]} failed"
    columns = BarColumn(), MofNCompleteColumn(), TextColumn(text), TimeRemainingColumn()
    started, done, failures = time.monotonic(), 0, 0
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("flights", total=total, rate=0.0, failures=0)

        def ended(failed: bool) -> None:
            nonlocal done, failures
            done, failures = done + 1, failures + failed
            rate = done / max(time.monotonic() - started, 1e-3)
            shown.update(task, completed=done, rate=rate, failures=failures)

        yield ended


@contextmanager
def progress_bars(jobs: Sequence[ReplayJob]) -> Iterator[Any]:
    """A function that gives each job its progress report: a bar on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda job: lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        tasks = {job.name: shown.add_task(job.name, total=None) for job in jobs}
        yield lambda job: lambda done, total: shown.update(tasks[job.name], completed=done, total=total)
