"""Scans on real local clusters of processes: the same bytes as on one machine, also when workers die."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fleet
import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import DataError, RequestError, StatisticError

#: Seconds after which a cluster that does not answer fails a test.
PATIENCE = 120


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Eighteen logs, so that there are two levels of merges; one more is there twice, one has no complete row."""
    folder = tmp_path_factory.mktemp("logs")
    names = fleet.fleet(folder, aircraft=6, flights=3)
    copy = fleet.write(folder / "7" / "copy.csv", fleet.run(95, 10.0))
    hollow = fleet.write(folder / "7" / "hollow.csv", fleet.run(60, 0.3) | {"v": np.full(60, np.nan)})
    return [*names, str(copy), str(hollow)]


@pytest.fixture(scope="module")
def plan(files: list[str]) -> ff.Plan:
    return ff.Plan(fleet.SHARED, files, chunk_rows=40)


@pytest.fixture(scope="module")
def alone(plan: ff.Plan, files: list[str]) -> ff.Stats:
    with pytest.warns(UserWarning, match="left out"):
        return ff.scan(plan, files, keys="aircraft={dir1}")


@pytest.fixture(scope="module")
def dask() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit="1GB"
        ) as cluster,
        distributed.Client(cluster, timeout=PATIENCE) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def ray() -> Iterator[Any]:
    ray = pytest.importorskip("ray", reason="Ray is not installed")
    ray.init(
        num_cpus=2,
        object_store_memory=80 << 20,
        include_dashboard=False,
        configure_logging=False,
        log_to_driver=False,
        runtime_env={"env_vars": {"PYTHONPATH": os.environ.get("PYTHONPATH", "")}},
    )
    yield ray
    ray.shutdown()


def revive(client: Any) -> None:
    """Waits for both workers; one whose nanny has given up, as happens on a busy machine, is started anew."""
    client.cluster.scale(2)
    client.wait_for_workers(2, timeout=PATIENCE)


def workers(client: Any) -> dict[str, int]:
    processes: dict[str, int] = client.run(os.getpid)
    return processes


def kill(process: int) -> None:
    os.kill(process, signal.SIGKILL)


class Once:
    """A progress callback that does something the first time that some, but not all, tasks are done."""

    def __init__(self, action: Callable[[], None]) -> None:
        self.action = action
        self.at: tuple[int, int] | None = None
        self.seen: list[tuple[str, int, int]] = []

    def __call__(self, stage: str, done: int, total: int) -> None:
        self.seen.append((stage, done, total))
        if self.at is None and 0 < done < total:
            self.at = (done, total)
            self.action()


# -- Dask


@pytest.mark.filterwarnings("ignore:left out")
@pytest.mark.parametrize("batch", [1, 4])
def test_dask_gives_the_bytes_of_one_machine(
    dask: Any, plan: ff.Plan, files: list[str], alone: ff.Stats, batch: int
) -> None:
    seen: list[tuple[str, int, int]] = []
    statistic = ff.distributed.scan(
        plan, files, dask, keys="aircraft={dir1}", batch=batch, progress=lambda *progress: seen.append(progress)
    )
    assert statistic.to_bytes() == alone.to_bytes()
    tasks = -(-len(files) // batch)
    total = tasks + -(-tasks // 8) + (tasks > 8)
    # A group of one is not merged.
    assert seen[-1][1] == seen[-1][2] <= total and [done for _, done, _ in seen] == list(range(1, seen[-1][2] + 1))


def test_dask_freezes_the_plan_of_a_recipe(dask: Any, files: list[str]) -> None:
    statistic = ff.distributed.scan(fleet.SHARED, files[:5], backend="dask")
    assert statistic == ff.scan(fleet.SHARED, files[:5])


def test_dask_reports_copies_of_files(dask: Any, plan: ff.Plan, files: list[str], tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="left out: .*copy.csv: the same content as .*flight_0.csv"):
        ff.distributed.scan(plan, [files[0], files[-2]], dask)
    # The same rows in another file are refused, as on one machine.
    rewritten = fleet.write(tmp_path / "rewritten.csv", fleet.run(95, 10.0), newline="\r\n")
    for scan in (lambda files: ff.scan(plan, files), lambda files: ff.distributed.scan(plan, files, dask)):
        with pytest.raises((DataError, StatisticError), match="rewritten.csv"):
            scan([files[0], str(rewritten)])


def test_dask_scans_tables_delayed_objects_and_futures(dask: Any, plan: ff.Plan) -> None:
    delayed = pytest.importorskip("dask").delayed
    runs = [fleet.run(70 + 9 * k, 3.0 * k) for k in range(5)]
    expected = ff.scan(plan, runs)
    assert ff.distributed.scan(plan, runs, dask).to_bytes() == expected.to_bytes()

    def load(k: int) -> dict[str, Any]:
        import numpy

        t = numpy.arange(70 + 9 * k) * 0.01
        x, v = numpy.sin(3.0 * t + 3.0 * k), numpy.cos(1.7 * t + 6.0 * k)
        thrust = 3.0 + x - 0.5 * x**2
        return {"t": t, "x": x, "v": v, "a": thrust - 0.7 * v, "b": 2.0 * thrust}

    mixed = [delayed(load)(0), dask.submit(load, 1), runs[2], delayed(load)(3), runs[4]]
    assert ff.distributed.scan(plan, mixed, dask, batch=2).to_bytes() == expected.to_bytes()


@pytest.mark.filterwarnings("ignore:left out")
def test_a_dask_worker_killed_in_the_middle_loses_nothing(
    dask: Any, plan: ff.Plan, files: list[str], alone: ff.Stats
) -> None:
    before = workers(dask)
    victim = sorted(before.values())[0]
    once = Once(lambda: kill(victim))
    statistic = ff.distributed.scan(plan, files, dask, keys="aircraft={dir1}", progress=once)
    assert once.at is not None and statistic.to_bytes() == alone.to_bytes()
    revive(dask)
    assert victim not in workers(dask).values()


def test_dying_dask_worker_loses_nothing(dask: Any, plan: ff.Plan, tmp_path: Path) -> None:
    delayed = pytest.importorskip("dask").delayed
    runs = [fleet.run(70 + 9 * k, 3.0 * k) for k in range(6)]
    marker = str(tmp_path / "died")

    def fatal(run: Any) -> Any:
        import os

        if not os.path.exists(marker):
            open(marker, "w").close()
            os._exit(1)
        return run

    statistic = ff.distributed.scan(plan, [*runs[:3], delayed(fatal)(runs[3]), *runs[4:]], dask)
    assert os.path.exists(marker) and statistic.to_bytes() == ff.scan(plan, runs).to_bytes()
    revive(dask)


@pytest.mark.filterwarnings("ignore:left out")
def test_all_dask_workers_restarted_in_the_middle_lose_nothing(
    dask: Any, plan: ff.Plan, files: list[str], alone: ff.Stats
) -> None:
    before = set(workers(dask).values())
    names = list(dask.scheduler_info()["workers"])

    def restart() -> None:
        dask.restart_workers(names, timeout=PATIENCE, raise_for_error=False)
        revive(dask)

    once = Once(restart)
    statistic = ff.distributed.scan(plan, files, dask, keys="aircraft={dir1}", progress=once)
    assert once.at is not None and statistic.to_bytes() == alone.to_bytes()
    assert not before & set(workers(dask).values())


@pytest.fixture
def small_dask() -> Iterator[tuple[Any, Any]]:
    """A cluster of one worker that a test may wreck, and its client."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster,
        distributed.Client(cluster, timeout=PATIENCE) as client,
    ):
        yield cluster, client


def test_dask_without_workers_names_missing_files(
    small_dask: Any, plan: ff.Plan, files: list[str]
) -> None:
    cluster, client = small_dask
    once = Once(lambda: cluster.scale(0))
    with pytest.raises(TimeoutError, match=r"worked for 3 s, and \d+ of 9 files are missing: .*flight_") as raised:
        ff.distributed.scan(plan, files[:9], client, timeout=3.0, progress=once)
    assert str(raised.value).count("flight_") == int(str(raised.value).split(" of 9 files")[0].split()[-1])
    # Workers that come within the time are waited for.
    threading.Timer(1.0, lambda: cluster.scale(1)).start()
    assert ff.distributed.scan(plan, files[:2], client, timeout=PATIENCE) == ff.scan(plan, files[:2])


def test_a_dask_cluster_that_is_restarted_ends_the_scan(small_dask: Any, plan: ff.Plan, files: list[str]) -> None:
    _, client = small_dask
    with pytest.raises(RuntimeError, match=r"the cluster ended the scan .* of 9 files"):
        ff.distributed.scan(plan, files[:9], client, progress=Once(lambda: client.restart(timeout=PATIENCE)))


def test_files_that_kill_every_dask_worker_are_named(small_dask: Any, plan: ff.Plan) -> None:
    dask = pytest.importorskip("dask")

    def fatal(run: Any) -> Any:
        import os

        os._exit(1)

    def impatient(dask_scheduler: Any) -> None:
        dask_scheduler.allowed_failures = 0

    client = small_dask[1]
    client.run_on_scheduler(impatient)
    runs = [fleet.run(70 + 9 * k, 3.0 * k) for k in range(2)]
    with pytest.raises(RuntimeError, match="workers died under .*: .* of 2 files"):
        ff.distributed.scan(plan, [runs[0], dask.delayed(fatal)(runs[1])], client)


def test_dask_workers_errors_are_raised_here(dask: Any, plan: ff.Plan, files: list[str], tmp_path: Path) -> None:
    broken = tmp_path / "broken.csv"
    broken.write_text("t,x,v\n0,1,2\n1,2,3\n")
    with pytest.raises((RequestError, DataError), match="b|a"):
        ff.distributed.scan(plan, [*files[:3], str(broken)], dask)
    with pytest.raises(RequestError, match="no row can be used"):
        ff.distributed.scan(plan, files[-1:], dask)
    # The cluster goes on, and nothing is left on it.
    assert ff.distributed.scan(plan, files[:2], dask) == ff.scan(plan, files[:2])
    deadline = time.monotonic() + PATIENCE
    while any(dask.has_what().values()) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(dask.has_what().values())


def test_ctrl_c_stops_a_scan_on_dask(dask: Any, plan: ff.Plan, files: list[str]) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ff.distributed.scan(plan, files[:9], dask, progress=Once(interrupt))
    assert ff.distributed.scan(plan, files[:2], dask) == ff.scan(plan, files[:2])


# -- Ray


@pytest.mark.filterwarnings("ignore:left out")
def test_ray_gives_the_bytes_of_one_machine(ray: Any, plan: ff.Plan, files: list[str], alone: ff.Stats) -> None:
    seen: list[tuple[str, int, int]] = []
    statistic = ff.distributed.scan(plan, files, ray, keys="aircraft={dir1}", progress=lambda *progress: seen.append(progress))
    assert statistic.to_bytes() == alone.to_bytes()
    assert seen[-1][1] == seen[-1][2] > len(files)


def test_initialised_ray_is_recognised(ray: Any, plan: ff.Plan) -> None:
    runs = [fleet.run(70 + 9 * k, 3.0 * k) for k in range(4)]
    references = [ray.put(run) for run in runs]
    assert ff.distributed.scan(plan, references).to_bytes() == ff.scan(plan, runs).to_bytes()
    assert ff.distributed.scan(plan, runs, backend="ray", batch=3) == ff.scan(plan, runs)


def ray_workers() -> set[int]:
    """Processes of this machine that run a task of ours on Ray."""
    processes = set()
    for process in Path("/proc").iterdir():
        if process.name.isdigit():
            try:
                command = (process / "cmdline").read_bytes()
            except OSError:
                continue
            if command.startswith(b"ray::") and b"signed" in command:
                processes.add(int(process.name))
    return processes


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="finds the workers in /proc")
def test_a_ray_worker_killed_in_the_middle_loses_nothing(ray: Any, plan: ff.Plan, tmp_path: Path) -> None:
    # Long enough to be met at work.
    runs = [fleet.run(60_000 + 10 * k, 3.0 * k) for k in range(8)]
    paths = [str(fleet.write(tmp_path / f"{k}.csv", run)) for k, run in enumerate(runs)]
    killed: list[int] = []
    over = threading.Event()

    def hunt() -> None:
        while not over.is_set() and not killed:
            for process in ray_workers():
                kill(process)
                killed.append(process)
                return
            time.sleep(0.002)

    hunter = threading.Thread(target=hunt)
    hunter.start()
    try:
        statistic = ff.distributed.scan(plan, paths, ray)
    finally:
        over.set()
        hunter.join()
    assert killed and statistic.to_bytes() == ff.scan(plan, paths).to_bytes()


def test_dying_ray_worker_loses_nothing(ray: Any, plan: ff.Plan, tmp_path: Path) -> None:
    runs = [fleet.run(70 + 9 * k, 3.0 * k) for k in range(4)]
    marker = str(tmp_path / "died")

    class Fatal(dict):  # type: ignore[type-arg]
        """A table that kills the worker that reads it first."""

        def __reduce__(self) -> Any:
            def rebuild(columns: Any) -> Any:
                import os

                if not os.path.exists(marker):
                    open(marker, "w").close()
                    os._exit(1)
                return columns

            return rebuild, (dict(self),)

    statistic = ff.distributed.scan(plan, [*runs[:3], Fatal(runs[3])], ray)
    assert os.path.exists(marker) and statistic.to_bytes() == ff.scan(plan, runs).to_bytes()


def test_pending_ray_task_names_missing_files(ray: Any, plan: ff.Plan, files: list[str]) -> None:
    class Idle:
        """A cluster whose workers are gone: nothing ever ends."""

        exceptions = ray.exceptions
        cancel = staticmethod(ray.cancel)

        def wait(self, references: Any, **_: Any) -> Any:
            time.sleep(0.05)
            return [], references

        def cluster_resources(self) -> dict[str, float]:
            return {}

        available_resources = cluster_resources

    pending = {ray.put(at): at for at in range(3)}
    cluster = ff.distributed._Ray()
    cluster._ray = Idle()
    watch = ff.distributed.Watch([[(None, name)] for name in files[:3]], 0.5, None)
    with pytest.raises(TimeoutError, match=r"worked for 0.5 s, and 3 of 3 files are missing: .*flight_0.csv, "):
        cluster._wait(None, pending, watch)


def test_ray_workers_errors_are_raised_here(ray: Any, plan: ff.Plan, files: list[str], tmp_path: Path) -> None:
    broken = tmp_path / "broken.csv"
    broken.write_text("t,x,v\n0,1,2\n1,2,3\n")
    with pytest.raises((RequestError, DataError)):
        ff.distributed.scan(plan, [*files[:3], str(broken)], ray)
    assert ff.distributed.scan(plan, files[:2], ray) == ff.scan(plan, files[:2])


# -- without a cluster


def test_wrong_calls_are_refused(plan: ff.Plan, files: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="backend = 'spark': give 'dask' or 'ray'"):
        ff.distributed.scan(plan, files, backend="spark")
    with pytest.raises(ValueError, match="batch = 0"):
        ff.distributed.scan(plan, files, batch=0)
    for wrong in (0, -1.0, "10"):
        with pytest.raises(ValueError, match="timeout = .*: give seconds above 0, or None"):
            ff.distributed.scan(plan, files, timeout=wrong)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="client is a int"):
        ff.distributed.scan(plan, files, client=3, batch=np.int64(2), timeout=np.float32(9.0))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="batch = np.True_"):
        ff.distributed.scan(plan, files, batch=np.True_)  # type: ignore[arg-type]
    with pytest.raises(StatisticError):
        ff.distributed.scan_part(b"no plan", [], [None], files[0])
    import sys

    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ImportError, match="pip install ray"):
        ff.distributed.scan(plan, files, backend="ray")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match="pip install 'dask"):
        ff.distributed.scan(plan, files, backend="dask")
