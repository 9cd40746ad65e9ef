"""The tables of docs/howto/auto.md: `fleetfoot auto` beside others on the same rows, and the errors that it printed beside those on rows that it never saw."""

import json
import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: A python with pysindy, scikit-learn, pyarrow, gymnasium and mcap-ros2-support.
PYTHON = Path(os.environ.get("FLEETFOOT_PEERS", ROOT / "target" / "peers" / "bin" / "python"))
#: Within this share of the best by hand.
NEAR = 1.1


def lines(fleetfoot, data, folder, names=()):
    words = [PYTHON, ROOT / "benches" / "peers" / "auto.py", fleetfoot, data, folder, *names]
    done = subprocess.run(list(map(str, words)), check=True, capture_output=True, text=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def short(value):
    if isinstance(value, str) or value is None:
        return "-"
    return "diverges" if value > 100 else f"{value:.3f}"


def table(rows):
    """Errors over those of persistence, mean over the states; then what `auto` printed beside the errors on the cut-off rows."""
    text = ["| log | steps | `auto` chose | `auto` | by hand | linear | ARX | pysindy | s |", "|---|---:|---|---:|---:|---:|---:|---:|---:|"]
    done = [row for row in rows if "failed" not in row]
    for row in done:
        best = next(iter(row["hands"]), [float("inf")])[0]
        name = row["name"] + (" (1)" if row["options"] else "") + (" (2)" if row["warning"] else "")
        cells = [name, row["horizon"], row["chosen"], *map(short, [row["auto"], best, row["linear"], row["arx"], row["pysindy"]]), f"{row['seconds']:.0f}"]
        text.append("| " + " | ".join(map(str, cells)) + " |")
    text += [f"| {row['name']} | - | failed: {row['failed']} | - | - | - | - | - | - |" for row in rows if "failed" in row]
    near = sum(row["auto"] <= NEAR * row["hands"][0][0] for row in done)
    worse = [row["name"] for row in done if row["auto"] > 1.0]
    text += ["", "(1) Columns or the unit of the stamps were named. (2) `auto` warned that the model is of little use.", ""]
    text += [f"{near} of {len(done)} are within a tenth of the best by hand, which was chosen on these very rows.", f"Worse than persistence: {', '.join(worse) or 'none'}."]
    text += ["", "| log | state | printed, 95 % interval | on the cut-off rows | within |", "|---|---|---|---:|---|"]
    within = less = count = 0
    for row in done:
        for state, value, low, high, error in row["printed"][:3]:
            if None in (value, low, high):
                continue
            held = low <= error <= high
            within, less, count = within + held, less + (error < low), count + 1
            text.append(f"| {row['name']} | `{state}` | {value:.3g}, {low:.3g} to {high:.3g} | {error:.3g} | {'yes' if held else 'less' if error < low else 'no'} |")
    return "\n".join([*text, "", f"{within} of {count} errors are within the printed interval, {less} below it (the first three states of every log)."])


def auto(fleetfoot, data):
    return table(lines(fleetfoot, data, ROOT / "target" / "auto-table"))
