"""Calls that need more memory than the process may have raise a MemoryError before they begin, and the interpreter lives."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from fleetfoot import exceptions

HERE = Path(__file__).parent

#: Calls that need about a gigabyte, where half of one is left (of what takes long a part of both); and what their message begins with.
CALLS = {
    "read": ("ff.read({f'x{k}': np.zeros(4_000_000) for k in range(30)}, dt=0.1)", "a table of 4000000 rows"),
    "model rows": (
        "ff.compare({'decay': decay}, ff.open({'x0': np.linspace(1, 2, 20_000_000)}, dt=0.1))",
        "a table of 20000000 rows",
    ),
    "predict": ("decay.predict(ff.open({'x0': np.linspace(1, 2, 20_000_000)}, dt=0.1))", "predictions of all rows"),
    "simulate": ("decay.simulate(np.ones((20_000, 1)), np.arange(0, 100, 0.01))", "a simulation of 20000 points"),
    "trajectories": (
        "decay.rollout({'x0': np.linspace(1, 2, 30_000)}, 20_000, starts=9_000, keep=True, recipe={'time': {'dt': 0.1}})",
        "9000 trajectories",
    ),
    "library": ("ff.PWA(1, degree=9).fit(random.normal(size=(3000, 8)), 0.01)", "1 episodes need a statistic of"),
    "filter": (
        "decay.filter(ff.open({'x0': np.linspace(1, 2, 600_000)}, dt=0.01), measured={'x0': 0.1}, keep=True)",
        "the estimates of all rows",
    ),
    "resimulate": (
        "decay.resimulate(ff.open({'x0': np.linspace(1, 2, 400_000)}, dt=0.01))",
        "an episode of 400000 rows on the grid",
    ),
    "messages": (
        "ff.read_mcap(log, '/odom', fields=['twist.twist.linear.x'] * 600_000)",
        "a table of 200 messages and 600000 fields",
    ),
    "k-means": ("ff.KMeans(2, init=np.ones((2, 10))).fit(small)", "k-means of 12000000 rows and 10 columns"),
    "regression": ("ff.Lasso().fit(wide, wide[:, 0])", "a regression on"),
}

SCRIPT = """
    import resource, tempfile, warnings
    import numpy as np
    import fleetfoot as ff

    warnings.simplefilter("ignore")
    ff.set_threads(2)
    t = np.arange(0, 5, 0.01)
    decay = ff.PWA().fit(np.exp(-t), t).model_
    small = np.broadcast_to(np.float32(1.0), (12_000_000, 10))
    wide = np.broadcast_to(np.float32(1.0), (20_000, 20_000))
    random = np.random.default_rng(0)
    if "log" in {call!r}:
        folder = tempfile.TemporaryDirectory()
        log = ff.generate("diffdrive", folder.name, seconds=2.0).files[0]
    taken = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    limit = taken + {left} + {own}
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    try:
        {call}
    except MemoryError as error:
        print(type(error).__name__, str(error))
    ff.KMeans(1).fit(np.arange(10.0)[:, None])
    print("alive")
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="limits memory as Linux does")
@pytest.mark.parametrize("name", CALLS)
def test_too_little_memory_is_an_exception(name: str) -> None:
    call, message = CALLS[name]
    # Arrays of the call itself are on top of what is left.
    array_bytes = {"read": 30 * 8 * 4_000_000, "model rows": 8 * 20_000_000, "predict": 8 * 20_000_000}.get(name, 0)
    head = f"import sys; sys.path[:0] = {[str(HERE), *sys.path]!r}\n"
    script = head + textwrap.dedent(SCRIPT).replace("{call!r}", repr(call)).replace("{call}", call)
    left = 1 << (27 if name == "filter" else 29)
    script = script.replace("{own}", str(array_bytes)).replace("{left}", str(left))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    message_line, alive = done.stdout.strip().splitlines()
    assert message_line.startswith(f"OutOfMemoryError {message}") and alive == "alive", done.stdout
    assert name != "k-means" or message_line.endswith("; cluster fewer rows, as X[::10]"), message_line


def test_the_class_is_a_memory_error() -> None:
    assert issubclass(exceptions.OutOfMemoryError, MemoryError)
    assert issubclass(exceptions.OutOfMemoryError, exceptions.FleetfootError)
