"""Where much work is done: here, in processes of this machine, or on the workers of a Dask scheduler; one interface."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager, contextmanager
from typing import Any, TypeVar

from drivers.errors import DriverError
from drivers.system.workers import worker_pool

Pool = Callable[[], AbstractContextManager[Executor]]
"""Opens the place where work is done."""

ANSWER_S = 10

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def processes(jobs: int, initializer: Callable[..., object] | None = None, *arguments: Any) -> Pool:
    """So many processes of this machine."""
    return lambda: worker_pool(jobs, initializer, arguments)


def dask(address: str) -> Pool:
    """The workers of the scheduler at ``address``, as "tcp://HOST:8786".

    Raises DriverError when Dask is not installed or no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise DriverError("--dask needs Dask: pip install 'landslope[scale]'") from None
    try:
        client = Client(address, timeout=f"{ANSWER_S}s")
    except (OSError, ValueError) as error:
        raise DriverError(
            f"--dask {address}: no scheduler answers: {error}; start one by 'dask scheduler'"
        ) from None

    @contextmanager
    def executor() -> Iterator[Executor]:
        with client:
            opened = client.get_executor(pure=False)
            try:
                yield opened
            except BaseException:
                opened.shutdown(wait=False)  # Ctrl-C: what was handed out is called back
                raise
            opened.shutdown()

    return executor


def each(
    pool: Pool | None, work: Callable[[_Item], _Result], items: Iterable[_Item], ahead: int
) -> Iterator[tuple[_Item, _Result | BaseException]]:
    """Every item with its result as it ends, or with the error that ended it; ``ahead`` are handed out at a time.

    Without a pool the work is done here, and an error is the caller's.
    """
    if pool is None:
        yield from ((item, work(item)) for item in items)
        return
    left = iter(items)
    with pool() as executor:
        waiting: dict[Future[_Result], _Item] = {}
        while True:
            for item in left:
                try:
                    waiting[executor.submit(work, item)] = item
                except BrokenExecutor as error:  # one of its processes died, and it takes no more
                    yield item, error
                    continue
                if len(waiting) >= ahead:
                    break
            if not waiting:
                return
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                failure, item = future.exception(), waiting.pop(future)
                yield item, (future.result() if failure is None else failure)
