"""Scans on a cluster: Dask and Ray. The result is that of one machine, bit for bit."""

from __future__ import annotations

import asyncio
import os
import sys
import time
import uuid
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal, Protocol

import numpy as np

from . import _core
from ._data import open as open_data
from ._progress import Progress, reporting
from ._stats import Plan, Recipe, Stats
from ._warnings import tell_all
from .exceptions import RequestError

__all__ = ["scan"]

#: Statistics that one task merges.
FAN_IN = 8

#: A part of a scan: its statistic, what was left out, and notes.
Part = tuple[Stats, list[str], list[str]]


def scan(
    plan: Plan | Recipe,
    files: Any,
    client: Any = None,
    *,
    backend: Literal["dask", "ray"] | None = None,
    keys: str | Iterable[str] = (),
    batch: int = 1,
    timeout: float | None = 600.0,
    progress: Progress = None,
) -> Stats:
    """Scans recordings on the workers of a cluster: one task for each file, then a tree of merges.

    The result has the bytes of ``fleetfoot.scan(plan, files)``: sums are kept by episode and chunk and merged by key,
    in any order and with repetitions. The tasks of a dead worker run again elsewhere, and a log cannot count twice.

    Parameters
    ----------
    plan : Plan, path, str or mapping
        A plan; or a recipe, whose plan is frozen from a pilot sample of all files.
    files : path, str or list
        Files, glob patterns and folders. They must have the same paths here and on the workers, relative ones from
        the same folder. Or a list of tables in memory (as in :func:`fleetfoot.open`), of ``dask.delayed`` objects and
        futures, or of references of Ray, whose values are tables.
    client : dask.distributed.Client or ray, optional
        Client of Dask, or the initialised module ``ray``. Default: Ray if initialised in this process, else the
        current client of Dask.
    backend : {"dask", "ray"}, optional
        Choice of the backend, if both are available.
    keys : str or list of str, optional
        Labels from paths, as in :func:`fleetfoot.scan`.
    batch : int, optional
        Number of files per task, for many small files.
    timeout : float, optional
        Seconds without work on the cluster after which the scan stops, with an error that names the missing files.
        Work of other users counts too. For workers in a queue use more seconds, or ``None`` for no limit.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of the stage's name, the tasks done and the tasks in all.

    Returns
    -------
    Stats

    Raises
    ------
    RequestError
        No row is complete; there is no file; the recipe cannot be understood.
    DataError
        A recording cannot be read; exceptions of workers are raised here.
    RuntimeError
        There is no cluster; workers died during a task too often, or the cluster cancelled it. The message names the
        files.
    TimeoutError
        No worker has worked for ``timeout`` seconds. The message names the missing files.
    ImportError
        The backend is not installed.

    Notes
    -----
    fleetfoot must be installed on the workers, in the same version. A task uses all cores of its machine. If workers
    share a machine, limit each: ``client.run(fleetfoot.set_threads, 1)``. Ctrl-C stops the scan and cancels waiting
    tasks. Dask gives up a task after three dead workers (``distributed.scheduler.allowed-failures``); Ray tries a
    task five times.

    Examples
    --------
    On a local cluster of processes::

        from dask.distributed import Client
        import fleetfoot as ff

        client = Client(n_workers=4)
        plan = ff.Plan("robot.toml", "runs/*.mcap")
        stats = ff.distributed.scan(plan, "runs/*.mcap", client)
    """
    labels = [keys] if isinstance(keys, str) else list(keys)
    if isinstance(batch, (bool, np.bool_)) or not isinstance(batch, (int, np.integer)) or batch < 1:
        raise ValueError(f"batch = {batch!r}: give a number of files from 1 on")
    if timeout is not None:
        if isinstance(timeout, (bool, np.bool_)) or not isinstance(timeout, (int, float, np.number)) or not timeout > 0:
            raise ValueError(f"timeout = {timeout!r}: give seconds above 0, or None to wait without end")
        timeout = float(timeout)
    cluster = _cluster(client, backend)
    sources = _sources(files)
    if not isinstance(plan, Plan):
        plan = Plan(plan, files)
    batch = int(batch)
    groups = [sources[at : at + batch] for at in range(0, len(sources), batch)]
    with reporting(progress) as callback:
        whole, skipped, notes = cluster.run(plan.to_bytes(), labels, groups, Watch(groups, timeout, callback))
    if whole.rows.complete == 0:
        rows = whole.rows
        raise RequestError(
            f"no row can be used: {rows.at_border} lack neighbours at the border of their episode, "
            f"{rows.incomplete} have a missing value; give other files"
        )
    tell_all(list(dict.fromkeys(notes)) + [f"left out: {name}" for name in skipped])
    return whole


# Item of a scan: the name of a run in memory and its table, or None and a path.
Source = tuple["str | None", Any]


def _sources(files: Any) -> list[Source]:
    if isinstance(files, (str, os.PathLike)):
        files = [files]
    if not isinstance(files, (list, tuple)):
        given = type(files).__name__
        raise TypeError(f"files is a {given}; give paths, or a list of paths, tables, delayed objects or references")
    if not files:
        raise RequestError("files is empty; give one at least")
    if all(isinstance(one, (str, os.PathLike)) for one in files):
        return [(None, path) for path in _core.Data.files(list(files)).names()]
    return [(f"run {at}", table) for at, table in enumerate(files)]


def scan_part(plan: bytes, keys: list[str], names: list[str | None], *sources: Any) -> Part:
    """Scans some of the files or tables; runs on a worker."""
    frozen = Plan.from_bytes(plan)
    datasets = [open_data(source, name=name) for name, source in zip(names, sources, strict=True)]
    data = datasets[0]._core.joined([dataset._core for dataset in datasets[1:]])
    core, skipped, notes = frozen._core.scan_with(data, keys, True, None)
    return Stats._of(core), skipped, notes


def merge_parts(*parts: Part) -> Part:
    """Joins parts in their order; runs on a worker."""
    core, skipped = parts[0][0]._core.appended([part[0]._core for part in parts[1:]])
    skipped = [name for part in parts for name in part[1]] + skipped
    return Stats._of(core), skipped, [note for part in parts for note in part[2]]


def _tree(parts: Sequence[Any], merge: Callable[[Sequence[Any]], Any]) -> Any:
    """Merges neighbours until one is left."""
    while len(parts) > 1:
        groups = [parts[at : at + FAN_IN] for at in range(0, len(parts), FAN_IN)]
        parts = [merge(group) if len(group) > 1 else group[0] for group in groups]
    return parts[0]


#: Seconds between two looks at the tasks, and between two at the workers.
LOOK, LOOK_AT_WORKERS = 0.1, 1.0
#: Files that a message names.
NAMED = 20


class Watch:
    """Progress of the tasks of a scan: finished tasks, missing files, time without work.

    Parameters
    ----------
    groups : list of list of Source
        Files or tables of each task, in the order of the tasks.
    timeout : float, optional
        Seconds without work after which the scan ends.
    callback : callable, optional
        Called with the number of finished tasks.
    """

    def __init__(self, groups: list[list[Source]], timeout: float | None, callback: Any) -> None:
        self._files = [[os.fspath(path) if name is None else name for name, path in group] for group in groups]
        self._left = set(range(len(groups)))
        self._timeout, self._callback = timeout, callback
        self._done = 0
        self._worked = self._looked = time.monotonic()

    @property
    def patience(self) -> float | None:
        """Longest wait for an answer of the cluster, in seconds."""
        return self._timeout

    def ended(self, group: int | None, tasks: int) -> None:
        """Records the end of a task of a group or a merge, out of all tasks."""
        if group is not None:
            self._left.discard(group)
        self._done += 1
        self._worked = time.monotonic()
        if self._callback is not None:
            self._callback("scan", self._done, tasks)

    def look(self, working: Callable[[], bool]) -> None:
        """Ends the scan if no worker has worked for too long; ``working`` queries the cluster."""
        now = time.monotonic()
        if self._timeout is None or now - self._looked < min(LOOK_AT_WORKERS, self._timeout / 2):
            return
        if working():
            self._worked = time.monotonic()
        elif now - self._worked > self._timeout:
            raise TimeoutError(
                f"no worker of the cluster has worked for {self._timeout:g} s, and {self.missing()}; start workers and "
                "scan again, or give timeout= more seconds"
            )
        self._looked = now

    def died(self, group: int | None) -> RuntimeError:
        """Error for workers that died during a task of a group or a merge."""
        what = "a merge, or what a file is made of" if group is None else self._named(self._files[group])
        return RuntimeError(
            f"workers died under {what}: {self.missing()}; give the workers more memory, or leave these files out"
        )

    def cancelled(self, why: object) -> RuntimeError:
        """Error for tasks that were cancelled from outside."""
        return RuntimeError(f"the cluster ended the scan ({why}): {self.missing()}; scan again")

    def missing(self) -> str:
        """The missing files, as text."""
        every = sum(map(len, self._files))
        files = [file for group in sorted(self._left) for file in self._files[group]]
        if not files:
            return f"the sums of all {every} files are lost"
        return f"{len(files)} of {every} files {'is' if len(files) == 1 else 'are'} missing: {self._named(files)}"

    @staticmethod
    def _named(files: list[str]) -> str:
        more = f" and {len(files) - NAMED} more" if len(files) > NAMED else ""
        return ", ".join(files[:NAMED]) + more


class Cluster(Protocol):
    """Cluster that runs the tasks."""

    def run(self, plan: bytes, keys: list[str], groups: list[list[Source]], watch: Watch) -> Part:
        """Scans every group, and merges."""


def _cluster(client: Any, backend: str | None) -> Cluster:
    if backend not in (None, "dask", "ray"):
        raise ValueError(f"backend = {backend!r}: give 'dask' or 'ray'")
    is_ray = client is not None and getattr(client, "__name__", None) == "ray"
    if client is not None and backend is not None and is_ray != (backend == "ray"):
        raise ValueError(f"backend = {backend!r} and client = {client!r} belong to two clusters; leave one of them out")
    if is_ray or backend == "ray" or (client is None and backend is None and _ray_is_up()):
        return _Ray()
    return _Dask(client)


def _ray_is_up() -> bool:
    ray = sys.modules.get("ray")
    return ray is not None and bool(ray.is_initialized())


#: Errors of Dask after its timeout, in all versions of Python.
TimeoutErrors = (TimeoutError, asyncio.TimeoutError)


class _Dask:
    """A cluster of ``dask.distributed``."""

    def __init__(self, client: Any) -> None:
        try:
            import distributed
        except ImportError as error:
            raise ImportError("a scan on Dask needs dask.distributed: pip install 'dask[distributed]'") from error
        if client is None:
            try:
                client = distributed.get_client()
            except ValueError as error:
                raise RuntimeError(
                    "there is no cluster: give client=dask.distributed.Client(...), or client=ray after ray.init()"
                ) from error
        if not isinstance(client, distributed.Client):
            raise TypeError(f"client is a {type(client).__name__}; give a dask.distributed.Client, or the module ray")
        if client.asynchronous:
            raise ValueError("client is asynchronous; give Client(asynchronous=False)")
        self._client: Any = client

    def run(self, plan: bytes, keys: list[str], groups: list[list[Source]], watch: Watch) -> Part:
        """Scans every group, and merges."""
        import distributed

        # Nothing but this call holds the futures, so that statistics that are merged are forgotten.
        root, pending = self._submit(plan, keys, groups)
        group_of = {future.key: at for at, future in enumerate(pending[: len(groups)])}
        total = len(pending)
        as_completed: Any = distributed.as_completed
        waiting = as_completed(pending)
        del pending
        try:
            while not waiting.is_empty():
                for future in waiting.next_batch(block=False):
                    self._check(future, group_of, watch)
                    watch.ended(group_of.get(future.key), total)
                    del future
                watch.look(self._works)
                time.sleep(LOOK)
            return self._value(root, group_of, watch)
        except BaseException:
            self._client.cancel([root, *waiting.futures])
            waiting.clear()
            raise
        finally:
            # A traceback keeps what this frame holds.
            del root, waiting

    def _value(self, root: Any, group_of: dict[Any, int], watch: Watch) -> Part:
        """The value of the last task, recomputed if lost."""
        import distributed

        wait: Any = distributed.wait
        while True:
            try:
                wait([root], timeout=LOOK)
            except TimeoutErrors:
                watch.look(self._works)
                continue
            self._check(root, group_of, watch)
            try:
                part: Part = root.result(timeout=watch.patience)
            except TimeoutErrors:
                watch.look(lambda: False)
            else:
                return part

    def _check(self, future: Any, group_of: dict[Any, int], watch: Watch) -> None:
        """Raises the error of a failed task."""
        import distributed

        # One that is lost is made again.
        if future.status == "error":
            error = future.exception()
            if isinstance(error, distributed.KilledWorker):
                raise watch.died(group_of.get(error.task)) from error
            raise error.with_traceback(future.traceback())
        if future.status == "cancelled":
            raise watch.cancelled("the task was cancelled; a restart of the cluster does that, and its end")

    def _works(self) -> bool:
        """True if a worker runs a task, of this scan or another, or fetches its data."""
        try:
            try:
                info = self._client.scheduler_info(n_workers=-1)
            except TypeError:
                # Before 2025 it had no such argument, and told of all.
                info = self._client.scheduler_info()
        except OSError:
            return False
        metrics = [worker.get("metrics", {}) for worker in info["workers"].values()]
        counts = [one.get("task_counts", one) for one in metrics]
        return any(one.get(state, 0) for one in counts for state in ("executing", "flight", "long-running"))

    def _submit(self, plan: bytes, keys: list[str], groups: list[list[Source]]) -> tuple[Any, list[Any]]:
        token = uuid.uuid4().hex
        # A task and no scattered data: it can be made again when the workers that have it die.
        frozen = self._client.submit(bytes, plan, key=f"fleetfoot-plan-{token}")
        parts = []
        for at, group in enumerate(groups):
            tables = [self._table(source) for _, source in group]
            names = [name for name, _ in group]
            key = f"fleetfoot-scan-{token}-{at}"
            parts.append(self._client.submit(scan_part, frozen, keys, names, *tables, key=key))
        all_parts = list(parts)

        def merge(group: Sequence[Any]) -> Any:
            key = f"fleetfoot-merge-{token}-{len(all_parts)}"
            all_parts.append(self._client.submit(merge_parts, *group, key=key))
            return all_parts[-1]

        return _tree(parts, merge), all_parts

    def _table(self, source: Any) -> Any:
        """A future of a delayed object; else the table itself."""
        if hasattr(source, "__dask_graph__") and hasattr(source, "dask"):
            return self._client.compute(source)
        return source


class _Ray:
    """The Ray of this process."""

    #: Times that a task is tried again when its worker dies.
    RETRIES = 4

    def __init__(self) -> None:
        try:
            import ray
        except ImportError as error:
            raise ImportError("a scan on Ray needs ray: pip install ray") from error
        if not ray.is_initialized():
            raise RuntimeError("Ray is not running: call ray.init() first")
        self._ray: Any = ray

    def run(self, plan: bytes, keys: list[str], groups: list[list[Source]], watch: Watch) -> Part:
        """Scans every group, and merges."""
        scan_remote = self._ray.remote(num_returns=2, max_retries=self.RETRIES)(_signed_scan)
        merge_remote = self._ray.remote(num_returns=2, max_retries=self.RETRIES)(_signed_merge)
        frozen = self._ray.put(plan)
        # The sign of each task, with the number of its group; a merge has none.
        pending: dict[Any, int | None] = {}

        def started(references: Any, group: int | None = None) -> Any:
            part, sign = references
            pending[sign] = group
            return part

        def scan_group(at: int, group: list[Source]) -> Any:
            names, sources = zip(*group, strict=True)
            return started(scan_remote.remote(frozen, keys, list(names), *sources), at)

        parts = [scan_group(at, group) for at, group in enumerate(groups)]
        root = _tree(parts, lambda group: started(merge_remote.remote(*group)))
        # Nothing holds a statistic but the merge that waits for it.
        del parts
        try:
            return self._wait(root, pending, watch)
        except BaseException as error:
            for reference in pending:
                self._ray.cancel(reference)
            cause = getattr(error, "cause", None)
            if isinstance(error, self._ray.exceptions.RayTaskError) and isinstance(cause, Exception):
                raise cause from error
            raise

    def _wait(self, root: Any, pending: dict[Any, int | None], watch: Watch) -> Part:
        """Removes finished tasks from ``pending`` until none is left, and fetches the root."""
        total = len(pending)
        while pending:
            ready, _ = self._ray.wait(list(pending), num_returns=1, timeout=0.5)
            for reference in ready:
                group = pending.pop(reference)
                self._get(reference, group, watch)
                watch.ended(group, total)
            watch.look(self._works)
        part: Part = self._get(root, None, watch)
        return part

    def _get(self, reference: Any, group: int | None, watch: Watch) -> Any:
        """The value of a task that has ended."""
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference, timeout=watch.patience)
        except (errors.WorkerCrashedError, errors.NodeDiedError, errors.OutOfMemoryError) as error:
            raise watch.died(group) from error
        except errors.GetTimeoutError as error:
            raise TimeoutError(f"a sum did not come within {watch.patience:g} s: {watch.missing()}") from error

    def _works(self) -> bool:
        """True if processors of the cluster are in use, by this scan or others."""
        total, free = self._ray.cluster_resources(), self._ray.available_resources()
        return bool(total.get("CPU", 0.0) > free.get("CPU", 0.0))


def _signed_scan(*arguments: Any) -> tuple[Part, None]:
    """A part and a flag, so that a check for failure does not fetch the part."""
    return scan_part(*arguments), None


def _signed_merge(*parts: Part) -> tuple[Part, None]:
    """As :func:`_signed_scan`."""
    return merge_parts(*parts), None
