"""Calls are safe: Ctrl-C, exceptions by kind, forks, threads, progress."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import fleet
import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import DataError, FleetfootError, InternalError, RequestError, StatisticError, WriteError

HERE = Path(__file__).parent
#: Seconds after which a process that does not answer fails a test.
PATIENCE = 120

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
needs_signals = pytest.mark.skipif(os.name != "posix", reason="SIGINT is sent as POSIX does")


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    yield
    ff.set_threads(0)


def rows(count: int, seed: int = 0) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    x, z, w = random.normal(size=(3, count))
    return {"x": x, "z": z, "w": w, "y": x * z - 0.3 * w + 1.0}


def recipe(degree: int) -> dict[str, Any]:
    inputs = {name: name for name in ("x", "z", "w")}
    return {"model": {"predict": "y", "degree": degree}, "inputs": inputs, "time": {"dt": 0.01}}


def python(script: str, *arguments: str) -> list[str]:
    """A command that runs a script in which ``fleetfoot`` and this folder can be imported."""
    head = f"import sys; sys.path[:0] = {[str(HERE), *sys.path]!r}\n"
    return [sys.executable, "-c", head + textwrap.dedent(script), *arguments]


# -- Ctrl-C


LONG = """
    import fleetfoot as ff, test_safety as here
    before = ff.scan(here.recipe(2), here.rows(500)).to_bytes()
    told, announced = [], []

    def progress(stage, done, total):
        told.append((stage, done, total))
        if stage == "scan" and done > 0 and not announced:
            announced.append(True)
            print("scanning", flush=True)

    try:
        ff.scan(here.recipe(9), here.rows(2_000_000), chunk_rows=4096, progress=progress)
    except KeyboardInterrupt:
        print("interrupted", *told[-1], flush=True)
    assert ff.scan(here.recipe(2), here.rows(500)).to_bytes() == before
    print("works", flush=True)
"""


@needs_signals
def test_ctrl_c_stops_only_the_call() -> None:
    with subprocess.Popen(python(LONG), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        watchdog = threading.Timer(PATIENCE, process.kill)
        watchdog.start()
        try:
            assert process.stdout.readline() == "scanning\n"
            process.send_signal(signal.SIGINT)
            sent = time.monotonic()
            word, stage, done, total = process.stdout.readline().split()
            waited = time.monotonic() - sent
            assert (word, stage) == ("interrupted", "scan") and int(done) < int(total)
            assert process.stdout.readline() == "works\n"
        finally:
            watchdog.cancel()
    print(f"interrupted after {waited:.3f} s, {done} of {total}")
    assert process.returncode == 0


#: Fits over and over for a minute at most, so that a signal meets one however fast they are; every interrupt is told with its time.
DENSE = """
    import sys, time, numpy as np, fleetfoot as ff
    rng = np.random.default_rng(0)
    X = rng.standard_normal((6000, 1500))
    X += rng.standard_normal((6000, 1))
    y = X[:, :700] @ rng.standard_normal(700) + 10.0 * rng.standard_normal(6000)
    fits = {
        "lasso_path": lambda: ff.lasso_path(X, y, alphas=400, eps=1e-6),
        "LassoCV": lambda: ff.LassoCV(cv=20, alphas=200, eps=1e-6).fit(X, y),
        "LassoLarsCV": lambda: ff.LassoLarsCV(cv=20, max_iter=10**6).fit(X, y),
        "Lars": lambda: ff.Lars(n_nonzero_coefs=1500).fit(X, y),
        "STLSQ": lambda: ff.STLSQ(threshold=0.1).fit(X, y),
        "Bolasso": lambda: ff.Bolasso(n_estimators=500, alpha=0.01).fit(X, y),
        "PWARegressor": lambda: ff.PWARegressor(n_regions=2, random_state=0).fit(X, y),
    }
    fit, end = fits[sys.argv[1]], time.monotonic() + 60.0
    told = 0
    while told < int(sys.argv[2]) and time.monotonic() < end:
        try:
            print("starts", flush=True)
            while time.monotonic() < end:
                fit()
        except KeyboardInterrupt:
            print("interrupted", time.monotonic(), flush=True)
            told += 1
    assert (ff.Lasso(alpha=0.1).fit(X[:300, :9], y[:300]).coef_ != 0).any()
    print("works", flush=True)
"""
#: Seconds from the start of a fit to its interrupts, and those that it may take to answer: half a second where the machine is its own, and the tests' build and
#: their neighbours slow it down.
MOMENTS = (0.2, 0.9, 2.3)
ANSWER = 3.0


@needs_signals
@pytest.mark.parametrize("fit", ["lasso_path", "LassoCV", "LassoLarsCV", "Lars", "STLSQ", "Bolasso", "PWARegressor"])
def test_ctrl_c_stops_a_dense_solve(fit: str) -> None:
    """A stop waits for a sweep, some columns or a panel of a factor, at any moment of a fit."""
    waited = []
    with subprocess.Popen(python(DENSE, fit, str(len(MOMENTS))), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        watchdog = threading.Timer(PATIENCE, process.kill)
        watchdog.start()
        try:
            for moment in MOMENTS:
                assert process.stdout.readline() == "starts\n"
                time.sleep(moment)
                process.send_signal(signal.SIGINT)
                sent = time.monotonic()
                word, at = process.stdout.readline().split()
                assert word == "interrupted"
                waited.append(float(at) - sent)
            assert process.stdout.readline() == "works\n"
        finally:
            watchdog.cancel()
            process.kill()
    print(f"{fit}: interrupted after {', '.join(f'{seconds:.3f}' for seconds in waited)} s")
    assert max(waited) < ANSWER


def test_raising_callback_stops_the_call() -> None:
    class Enough(Exception):
        pass

    seen: list[tuple[str, int, int]] = []

    def progress(stage: str, done: int, total: int) -> None:
        seen.append((stage, done, total))
        if stage == "scan":
            raise Enough

    with pytest.raises(Enough):
        ff.scan(recipe(7), rows(400_000), chunk_rows=4096, progress=progress)
    assert seen[-1][1] < seen[-1][2] or seen[-1][2] == 0


# -- Progress


def test_long_calls_announce_their_duration() -> None:
    random = np.random.default_rng(3)
    x = random.normal(size=(2000, 6))
    # 462 candidates of each of six equations in ten folds: minutes. The warning is an error here, which stops the call.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message="this takes about", category=ff.FleetfootWarning)
        with pytest.raises(ff.FleetfootWarning, match="this takes about .* make it shorter"):
            ff.SINDy(library="poly(5)", smooth_states="off", weak="off").fit(x, 0.01 * np.arange(2000.0))


def test_progress_is_reported_by_stage() -> None:
    seen: list[tuple[str, int, int]] = []
    ff.scan(recipe(6), rows(300_000), chunk_rows=4096, progress=lambda *progress: seen.append(progress))
    counts = [(done, total) for stage, done, total in seen if stage == "scan"]
    assert counts and all(0 <= done <= total for done, total in counts if total)
    assert [done for done, _ in counts] == sorted(done for done, _ in counts)


def test_tqdm_shows_the_stages(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm", reason="tqdm is not installed")
    expected = ff.scan(recipe(6), rows(300_000), chunk_rows=4096)
    assert ff.scan(recipe(6), rows(300_000), chunk_rows=4096, progress=True) == expected
    assert "scan" in capfd.readouterr().err


# -- Exceptions


def test_error_kinds_have_classes(tmp_path: Path) -> None:
    stats = ff.scan(recipe(1), rows(200))
    for call, kind, base in [
        (lambda: ff.scan({"model": {"predikt": "y"}}, rows(9)), RequestError, ValueError),
        (lambda: ff.scan(recipe(1) | {"columns": {"u": "sin("}}, rows(9)), RequestError, ValueError),
        (lambda: ff.scan(recipe(1), str(tmp_path / "none.csv")), DataError, ValueError),
        (lambda: ff.Stats.from_bytes(b""), StatisticError, ValueError),
        (lambda: stats + stats, StatisticError, ValueError),
        (lambda: stats.save(tmp_path / "none" / "a.stats"), WriteError, OSError),
    ]:
        with pytest.raises(kind) as raised:
            call()
        assert isinstance(raised.value, FleetfootError) and isinstance(raised.value, base)
        assert type(raised.value) is kind and str(raised.value)


@pytest.mark.skipif(sys.platform != "linux", reason="limits its memory as Linux does")
def test_threads_that_cannot_be_started_are_an_error() -> None:
    script = """
        import resource
        import fleetfoot as ff, test_safety as here
        from fleetfoot.exceptions import InternalError
        data, plain = here.rows(200), here.recipe(1)
        before = ff.scan(plain, data)
        used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + (64 << 20), resource.RLIM_INFINITY))
        ff.set_threads(512)
        try:
            ff.scan(plain, data)
        except InternalError as error:
            assert "set_threads(1)" in str(error)
            print("refused", flush=True)
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        ff.set_threads(1)
        assert ff.scan(plain, data) == before
        print("works", flush=True)
    """
    # A thread that starts with the very last of the memory is ended by glibc, with the whole process: seldom, and never
    # five times.
    for _ in range(5):
        done = subprocess.run(python(script), capture_output=True, text=True, timeout=PATIENCE)
        if "Fatal glibc error" not in done.stderr:
            break
    assert done.stdout == "refused\nworks\n", done.stderr


# -- Threads


def test_the_number_of_threads_does_not_change_a_bit() -> None:
    results = []
    for count in (1, 2, 7):
        ff.set_threads(count)
        assert ff.thread_count() == count
        stats = ff.scan(recipe(4), [rows(30_000), rows(7_000, 1)], chunk_rows=1000)
        lasso = stats.solve("lasso", 0.01)
        results.append((stats.to_bytes(), lasso.coefficients.tobytes(), lasso.to_json()))
    assert results[0] == results[1] == results[2]


def test_absurd_numbers_of_threads_are_refused() -> None:
    with pytest.raises(RequestError, match="100000 threads are too many"):
        ff.set_threads(100_000)
    with pytest.raises(RequestError, match="count=-1"):
        ff.set_threads(-1)
    assert ff.thread_count() >= 1


def test_python_threads_at_once_find_the_same_bits() -> None:
    def work(seed: int) -> bytes:
        return ff.scan(recipe(4), rows(40_000, seed), chunk_rows=1000).to_bytes()

    alone = [work(seed) for seed in range(6)]
    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(work, range(6))) == alone


def test_other_python_threads_run_during_a_call() -> None:
    data = rows(400_000)
    ticks, over = [0], threading.Event()

    def tick() -> None:
        while not over.is_set():
            time.sleep(0.001)
            ticks[0] += 1

    ticker = threading.Thread(target=tick)
    ticker.start()
    try:
        before = ticks[0]
        ff.scan(recipe(7), data, chunk_rows=4096)
        during = ticks[0] - before
    finally:
        over.set()
        ticker.join()
    # With the lock held there would be one or two: those of the moments before and after.
    assert during >= 20


# -- Forks


def digest() -> str:
    return hashlib.sha256(ff.scan(recipe(4), rows(20_000), chunk_rows=1000).to_bytes()).hexdigest()


def in_child(work: Any) -> str:
    """Result of a forked child, as a text."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            signal.alarm(PATIENCE)
            os.write(writer, work().encode())
            code = 0
        finally:
            os._exit(code)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        result = pipe.read()
    assert os.waitpid(child, 0)[1] == 0
    return result


@needs_fork
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_finds_the_same_bits() -> None:
    expected = digest()
    assert in_child(digest) == expected
    # And its own child.
    assert in_child(lambda: in_child(digest) if digest() == expected else "") == expected
    assert digest() == expected


@needs_fork
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_child_forked_during_a_call_works() -> None:
    expected = digest()
    scanning = threading.Event()
    statistics: list[bytes] = []

    def progress(stage: str, done: int, total: int) -> None:
        if stage == "scan":
            scanning.set()

    def work() -> None:
        statistics.append(ff.scan(recipe(7), rows(400_000), chunk_rows=4096, progress=progress).to_bytes())

    thread = threading.Thread(target=work)
    thread.start()
    assert scanning.wait(PATIENCE)
    assert in_child(digest) == expected
    thread.join()
    assert statistics == [ff.scan(recipe(7), rows(400_000), chunk_rows=4096).to_bytes()]


@needs_fork
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_pools_of_forked_processes_work() -> None:
    expected = fleet_digest(3)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map_async(fleet_digest, [3, 3, 3]).get(PATIENCE) == [expected] * 3


def fleet_digest(phase: float) -> str:
    stats = ff.scan(fleet.SHARED, fleet.run(500, phase))
    return hashlib.sha256(stats.to_bytes()).hexdigest()


def test_internal_error_is_a_runtime_error() -> None:
    assert issubclass(InternalError, RuntimeError) and not issubclass(InternalError, ValueError)
