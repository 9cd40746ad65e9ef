"""Every estimator beside its peer: the same arrays, the same answer, time and memory; and how long Ctrl-C is waited for.

    python side_by_side.py [--rows 1000000] [--only KMeans,Lars] [--set all] [--repeat 3] [--minutes 90] [--limit 300]
    python side_by_side.py --interrupt [--only "LassoCV 5000x10000 C"]

Both sides of a case run in one process by turns, who begins changing too: what else the machine does meets both. Times are the medians of the fits (or
calls) alone, by the clock and of the processor over all threads, and the ratio is the median over the pairs; short fits are repeated more often.
`--set` (or FLEETFOOT_BENCH) chooses the cases: `classes`, one of every estimator; `shapes`, from small to large, tall and wide; `quick`, those shapes
of at most ten million values in the order of C. Memory is the peak of the process during a fit above what it held before, with the arrays loaded: 0 means
that nothing of the size of the input was made. The answers are compared in the same run, relative to the largest number of the peer's. A case that takes
longer than the limit is told as such, and no case begins after so many minutes: what was left out is listed at the end.

`--interrupt` sends SIGINT at five moments of a fit, and tells the longest time until KeyboardInterrupt is there.

Bias: the peers run with the threads that they choose (BLAS, OpenMP), which may not sleep at once when our turn comes; data are Gaussian and well
conditioned; every side is warmed up on a small part of the rows.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from cases import CASES, SHAPES, Answer, Case, shape_cases, wide_cases

#: Seconds of one side after which a case is not repeated.
ENOUGH = 20.0
#: Pairs of a case whose fits are short, and the seconds that they may take.
MOST, SHORT = 31, 3.0
#: Moments of a fit at which it is interrupted.
MOMENTS = (0.05, 0.25, 0.5, 0.75, 0.95)
#: Fits that are interrupted: where one step of the solver costs the most.
INTERRUPTED = [
    "LassoCV 5000x10000 C",
    "LassoLarsCV 5000x10000 C",
    "LassoCV 1000000x300 C",
    "Bolasso 5000x2000 C",
    "STLSQ 5000x2000 C",
    "PWARegressor 5000x2000 C",
]


def peak() -> int:
    """Peak resident bytes since the last reset."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return 1024 * int(line.split()[1])
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def resident() -> int:
    return os.sysconf("SC_PAGESIZE") * int(Path("/proc/self/statm").read_text().split()[1])


def loaded(name: str, folder: Path) -> tuple[Case, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """In the child: a case, its arrays, and a small part of these for imports and threads, which are no part of a fit."""
    warnings.simplefilter("ignore")
    arrays = dict(np.load(folder / f"{name}.npz"))
    small = {key: (value[: max(400, len(value) // 1000)] if value.ndim and key not in ("start", "G", "Xy") else value) for key, value in arrays.items()}
    return CASES[name], arrays, small


def warm_up(run: Callable[[dict[str, np.ndarray]], Answer], small: dict[str, np.ndarray]) -> None:
    """Imports and threads; that some refuse so few rows does not matter."""
    with contextlib.suppress(ValueError):
        run(small)


def run_pairs(name: str, folder: Path, repeat: int) -> None:
    """The child of a comparison: fits by turns, and tells time and memory after every one."""
    case, arrays, small = loaded(name, folder)
    sides = {"ours": case.ours, "theirs": case.theirs}
    for run in sides.values():
        warm_up(run, small)
    spent = dict.fromkeys(sides, 0.0)
    for turn in range(MOST):
        if turn and (max(spent.values()) > ENOUGH or (turn >= repeat and sum(spent.values()) > SHORT)):
            break
        for who in sorted(sides, reverse=turn % 2 == 1):
            Path("/proc/self/clear_refs").write_text("5")
            before, start, used = resident(), time.perf_counter(), time.process_time()
            answer = sides[who](arrays)
            seconds, processor = time.perf_counter() - start, time.process_time() - used
            spent[who] += seconds
            np.savez(folder / f"{name}.{who}.npz", **answer)
            print(json.dumps({"who": who, "seconds": seconds, "processor": processor, "bytes": max(0, peak() - before)}), flush=True)


def difference(ours: Answer, theirs: Answer) -> float:
    worst = 0.0
    for key in theirs:
        a, b = np.asarray(ours[key], dtype=float), np.asarray(theirs[key], dtype=float)
        if a.shape != b.shape:
            return float("inf")
        scale = np.abs(b).max(initial=0.0)
        worst = max(worst, float(np.abs(a - b).max(initial=0.0) / (scale if scale > 0 else 1.0)))
    return worst


def compared(name: str, arguments: argparse.Namespace) -> tuple[str, float | None]:
    """Both sides of a case: a line of the table, and the difference of the answers where both have one."""
    case = CASES[name]
    with tempfile.TemporaryDirectory() as folder:
        size = written(name, arguments, Path(folder))
        sides, running = pairs(name, folder, arguments)
        off = None
        if sides["ours"] and sides["theirs"]:
            off = difference(*(dict(np.load(Path(folder) / f"{name}.{who}.npz")) for who in ("ours", "theirs")))
    cells = []
    for clock in ("seconds", "processor"):
        times = {who: [fit[clock] for fit in fits] for who, fits in sides.items()}
        for who in ("ours", "theirs"):
            none = f"> {arguments.limit:g}" if who == running else "-"
            cells.append(f"{statistics.median(times[who]):.4g}" if times[who] else none)
        ratios = [theirs / max(ours, 1e-9) for ours, theirs in zip(times["ours"], times["theirs"], strict=False)]
        cells.append(f"{statistics.median(ratios):.2f}" if ratios else "-")
    cells += [f"{max(fit['bytes'] for fit in sides[who]) / 2**20:.0f}" if sides[who] else "-" for who in ("ours", "theirs")]
    cells.append("-" if off is None else f"{off:.1e}")
    return f"| `{name}` | {case.peer} | {size} | {' | '.join(cells)} |", off


def written(name: str, arguments: argparse.Namespace, folder: Path) -> str:
    """Writes the arrays of a case for its child, and tells their shapes."""
    arrays = CASES[name].data(arguments.rows)
    np.savez(folder / f"{name}.npz", **arrays)
    return " + ".join("x".join(map(str, value.shape)) for value in arrays.values() if value.ndim)


def pairs(name: str, folder: str, arguments: argparse.Namespace) -> tuple[dict[str, list[dict[str, Any]]], str]:
    """The fits of either side, and whose turn it was when the limit was over (none: it was not)."""
    command = [sys.executable, __file__, "--child", name, folder, "--repeat", str(arguments.repeat)]
    running = ""
    try:
        done = subprocess.run(command, capture_output=True, timeout=arguments.limit)
        output = done.stdout
        if done.returncode != 0:
            raise SystemExit(done.stderr.decode())
    except subprocess.TimeoutExpired as late:
        output = late.stdout or b""
        running = "theirs" if output.count(b"\n") == 1 else "ours"
    fits = [json.loads(line) for line in output.decode().splitlines()]
    return {who: [fit for fit in fits if fit["who"] == who] for who in ("ours", "theirs")}, running


def run_interrupted(name: str, folder: Path) -> None:
    """The child that is interrupted: tells how long a fit takes, then fits, once for every signal."""
    case, arrays, small = loaded(name, folder)
    warm_up(case.ours, small)
    start = time.monotonic()
    case.ours(arrays)
    print(time.monotonic() - start, flush=True)
    for _ in MOMENTS:
        finished = False
        try:
            print("begins", flush=True)
            case.ours(arrays)
            finished = True
            while True:
                time.sleep(60.0)
        except KeyboardInterrupt:
            print(json.dumps({"at": time.monotonic(), "finished": finished}), flush=True)


def interrupted(name: str, arguments: argparse.Namespace) -> str:
    """A line of the table of interrupts."""
    waited = []
    with tempfile.TemporaryDirectory() as folder:
        size = written(name, arguments, Path(folder))
        command = [sys.executable, __file__, "--child", name, folder, "--interrupt"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            watchdog = threading.Timer(arguments.limit, child.kill)
            watchdog.start()
            try:
                assert child.stdout is not None
                seconds = float(child.stdout.readline() or "inf")
                for moment in MOMENTS:
                    # What else a fit prints is none of ours.
                    if not any(line == "begins\n" for line in child.stdout):
                        break
                    time.sleep(moment * seconds)
                    child.send_signal(signal.SIGINT)
                    sent = time.monotonic()
                    report = next((json.loads(line) for line in child.stdout if line.startswith("{")), None)
                    if report is not None and not report["finished"]:
                        waited.append(report["at"] - sent)
            finally:
                watchdog.cancel()
                child.kill()
    longest = f"{max(waited):.3f}" if waited else "-"
    return f"| `{name}` | {size} | {seconds:.3g} | {len(waited)} | {longest} |"


def chosen(which: str) -> list[str]:
    """The cases of a set."""
    shaped = {*shape_cases(), *wide_cases()}
    if which == "classes":
        return [name for name in CASES if name not in shaped]
    if which == "shapes":
        return [name for name in CASES if name in shaped]
    if which == "quick":
        size = {f"{rows}x{columns}": rows * columns for rows, columns in SHAPES}
        small = {shape for shape, values in size.items() if values <= 10_000_000}
        return [name for name in CASES if name in shaped and name.endswith(" C") and name.split()[1] in small]
    return list(CASES)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--only", default="")
    sets = ["all", "classes", "shapes", "quick"]
    parser.add_argument("--set", choices=sets, default=os.environ.get("FLEETFOOT_BENCH", "all"), help="which cases, where none are named")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--minutes", type=float, default=90.0, help="after which no case begins")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds that one side of a case may take, imports and all")
    parser.add_argument("--interrupt", action="store_true", help="how long Ctrl-C is waited for, in place of the comparison")
    parser.add_argument("--child", nargs=2, metavar=("NAME", "FOLDER"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        name, folder = arguments.child[0], Path(arguments.child[1])
        if arguments.interrupt:
            run_interrupted(name, folder)
        else:
            run_pairs(name, folder, arguments.repeat)
        return 0
    if arguments.interrupt:
        print("| estimator | input | a fit, s | interrupted | longest wait, s |")
        print("|---|---|---:|---:|---:|")
        for name in [name for name in arguments.only.split(",") if name] or INTERRUPTED:
            print(interrupted(name, arguments), flush=True)
        return 0
    wanted = [name for name in arguments.only.split(",") if name] or chosen(arguments.set)
    print(
        "| estimator | peer | input | ours, s | peer, s | ratio | ours, processor s | peer, processor s | ratio | ours, MiB | peer, MiB | difference |"
    )
    print("|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    wrong: list[str] = []
    begun = time.monotonic()
    for place, name in enumerate(wanted):
        if time.monotonic() - begun > 60.0 * arguments.minutes:
            print(f"LEFT OUT after {arguments.minutes:g} minutes: {', '.join(wanted[place:])}", file=sys.stderr)
            break
        line, off = compared(name, arguments)
        print(line, flush=True)
        if off is not None and not off <= CASES[name].tolerance:
            wrong.append(f"{name}: {off:.1e}, more than {CASES[name].tolerance:.1e} ({CASES[name].reason})")
    for line in wrong:
        print(f"DIFFERS {line}", file=sys.stderr)
    print(f"{(time.monotonic() - begun) / 60.0:.0f} minutes", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
