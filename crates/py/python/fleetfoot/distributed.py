"""Scans on a cluster: Dask and Ray. The result is that of one machine, bit for bit."""

from __future__ import annotations

import os
import sys
import uuid
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

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
    backend: str | None = None,
    keys: str | Iterable[str] = (),
    batch: int = 1,
    progress: Progress = None,
) -> Stats:
    """Scans recordings on the workers of a cluster: one task for each file, then a tree of merges.

    The result has the bytes of ``fleetfoot.scan(plan, files)``: sums are kept by episode and chunk and joined by key,
    so it does not matter who summed what in which order, nor how often: a worker that dies loses nothing, its tasks run
    again elsewhere, and a log cannot count twice.

    Parameters
    ----------
    plan : Plan, path, str or mapping
        A plan; or a recipe, whose plan is then frozen here from a pilot sample of all files.
    files : path, str or list
        Files, glob patterns and folders. They must be visible under the same paths here and on the workers, relative
        ones from the same folder. Or a list of tables in memory (as :func:`fleetfoot.open` takes them), of
        ``dask.delayed`` objects and futures, or of references of Ray, whose values are tables.
    client : dask.distributed.Client or ray, optional
        Where the tasks run: a client of Dask, or the module ``ray`` (initialised). When not given, the Ray that is
        initialised in this process, else the current client of Dask.
    backend : {"dask", "ray"}, optional
        Which of the two, where both are there.
    keys : str or list of str, optional
        Labels from paths, as in :func:`fleetfoot.scan`.
    batch : int, optional
        Files of a task; more than one for many small files.
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
        A recording cannot be read; what a worker raises is raised here.
    RuntimeError
        There is no cluster.
    ImportError
        The backend is not installed.

    Notes
    -----
    fleetfoot must be installed on the workers, in the same version. A task uses all cores of its machine; where several
    workers share one, give each its part: ``client.run(fleetfoot.set_threads, 1)``. Ctrl-C stops the scan: tasks that
    have not begun are cancelled. A Dask worker may die three times under a task before Dask gives the task up
    (``distributed.scheduler.allowed-failures``); Ray tries a task five times.

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
    if isinstance(batch, bool) or not isinstance(batch, int) or batch < 1:
        raise ValueError(f"batch = {batch!r}: give a number of files from 1 on")
    cluster = _cluster(client, backend)
    sources = _sources(files)
    if not isinstance(plan, Plan):
        plan = Plan(plan, files)
    groups = [sources[at : at + batch] for at in range(0, len(sources), batch)]
    with reporting(progress) as callback:
        whole, skipped, notes = cluster.run(plan.to_bytes(), labels, groups, callback)
    if whole.rows.complete == 0:
        rows = whole.rows
        raise RequestError(
            f"no row can be used: {rows.at_border} lack neighbours at the border of their episode, "
            f"{rows.incomplete} have a missing value; give other files"
        )
    tell_all(list(dict.fromkeys(notes)) + [f"left out: {name}" for name in skipped])
    return whole


# What is scanned: the name of a run in memory and its table, or None and a path.
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


class Cluster(Protocol):
    """Where tasks run."""

    def run(self, plan: bytes, keys: list[str], groups: list[list[Source]], callback: Any) -> Part:
        """Scans every group, and merges."""


def _cluster(client: Any, backend: str | None) -> Cluster:
    if backend not in (None, "dask", "ray"):
        raise ValueError(f"backend = {backend!r}: give 'dask' or 'ray'")
    is_ray = client is not None and getattr(client, "__name__", None) == "ray"
    if client is not None and backend is not None and is_ray != (backend == "ray"):
        raise ValueError(f"backend = {backend!r} and client = {client!r} are of two clusters; leave one of them away")
    if is_ray or backend == "ray" or (client is None and backend is None and _ray_is_up()):
        return _Ray()
    return _Dask(client)


def _ray_is_up() -> bool:
    ray = sys.modules.get("ray")
    return ray is not None and bool(ray.is_initialized())


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

    def run(self, plan: bytes, keys: list[str], groups: list[list[Source]], callback: Any) -> Part:
        """Scans every group, and merges."""
        import distributed

        # Nothing but this call holds the futures, so that statistics that are merged are forgotten.
        root, pending = self._submit(plan, keys, groups)
        done, total = 0, len(pending)
        as_completed: Any = distributed.as_completed
        waiting = as_completed(pending)
        del pending
        try:
            for future in waiting:
                if future.status != "finished":
                    future.result()
                del future
                done += 1
                if callback is not None:
                    callback("scan", done, total)
            found: Part = root.result()
            return found
        except BaseException:
            self._client.cancel([root, *waiting.futures])
            waiting.clear()
            raise
        finally:
            # A traceback keeps what this frame holds.
            del root, waiting

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
        self._ray = ray

    def run(self, plan: bytes, keys: list[str], groups: list[list[Source]], callback: Any) -> Part:
        """Scans every group, and merges."""
        scan_remote = self._ray.remote(num_returns=2, max_retries=self.RETRIES)(_signed_scan)
        merge_remote = self._ray.remote(num_returns=2, max_retries=self.RETRIES)(_signed_merge)
        frozen = self._ray.put(plan)
        pending: list[Any] = []

        def started(references: Any) -> Any:
            part, sign = references
            pending.append(sign)
            return part

        def scan_group(group: list[Source]) -> Any:
            names, sources = zip(*group, strict=True)
            return started(scan_remote.remote(frozen, keys, list(names), *sources))

        parts = [scan_group(group) for group in groups]
        root = _tree(parts, lambda group: started(merge_remote.remote(*group)))
        # Nothing holds a statistic but the merge that waits for it.
        del parts
        try:
            return self._wait(root, pending, callback)
        except BaseException as error:
            for reference in pending:
                self._ray.cancel(reference)
            cause = getattr(error, "cause", None)
            if isinstance(error, self._ray.exceptions.RayTaskError) and isinstance(cause, Exception):
                raise cause from error
            raise

    def _wait(self, root: Any, pending: list[Any], callback: Any) -> Part:
        """Takes what is done from ``pending`` until nothing is left, and gets the root."""
        done, total = 0, len(pending)
        while pending:
            ready, pending[:] = self._ray.wait(pending, num_returns=1, timeout=0.5)
            self._ray.get(ready)
            done += len(ready)
            if callback is not None:
                callback("scan", done, total)
        found: Part = self._ray.get(root)
        return found


def _signed_scan(*arguments: Any) -> tuple[Part, None]:
    """A part, and a sign that it is there: looking whether it failed does not fetch it."""
    return scan_part(*arguments), None


def _signed_merge(*parts: Part) -> tuple[Part, None]:
    """As :func:`_signed_scan`."""
    return merge_parts(*parts), None
