"""Writes arrays by numpy (`.npy`, `.npz`) and scipy (`.mat`), and prints every number of their columns.

    python write_arrays.py OUTDIR [ROWS]

A JSON line a file: its name, its rows, and its columns by the names that they are to have, numbers as they are and texts as texts. 2,000 rows unless
ROWS says otherwise.

Needs numpy, scipy.
"""

import json
import math
import sys
from pathlib import Path

import numpy
from scipy.io import savemat

ROWS = int(sys.argv[2]) if len(sys.argv) > 2 else 2000


def plain(values):
    values = numpy.asarray(values)
    if values.dtype.kind in "SU":
        return [value.decode() if isinstance(value, bytes) else str(value) for value in values]
    if values.dtype.kind in "Mm":
        return values.astype("int64").tolist()
    if values.dtype.kind == "b":
        return values.astype(int).tolist()
    return [value if math.isfinite(value) else None for value in values.astype("f8" if values.dtype.kind == "f" else values.dtype).tolist()]


def tell(name: str, columns: dict):
    print(json.dumps({"file": name, "rows": ROWS, "columns": {key: plain(values) for key, values in columns.items()}}))


def main():
    folder = Path(sys.argv[1])
    rng = numpy.random.default_rng(7)
    t = 0.01 * numpy.arange(ROWS)
    table = rng.standard_normal((ROWS, 3))
    table[3, 1] = numpy.nan

    numpy.save(folder / "plain.npy", table)
    tell("plain.npy", {f"x{k}": table[:, k] for k in range(3)})
    numpy.save(folder / "fortran.npy", numpy.asfortranarray(table.astype(">f4")))
    tell("fortran.npy", {f"x{k}": table[:, k].astype("f4") for k in range(3)})
    numpy.save(folder / "vector.npy", t.astype("f2"))
    tell("vector.npy", {"x0": t.astype("f2")})

    kind = numpy.dtype(
        [("t", "<f8"), ("pose", [("x", "<f4"), ("y", ">f4")]), ("q", "<i2", (4,)), ("name", "U5"), ("code", "S3"), ("on", "?"), ("stamp", "<M8[us]"), ("big", "<u8"), ("z", "<c16")],
        align=True,
    )
    rows = numpy.zeros(ROWS, kind)
    rows["t"], rows["pose"]["x"], rows["pose"]["y"] = t, table[:, 0], table[:, 1]
    rows["q"], rows["on"] = rng.integers(-(2**15), 2**15, (ROWS, 4)), rng.random(ROWS) < 0.5
    rows["name"], rows["code"] = [f"né{k % 7}" for k in range(ROWS)], [f"c{k % 5}" for k in range(ROWS)]
    rows["stamp"] = numpy.datetime64("2026-11-27T12:00:00") + (t * 1e6).astype("timedelta64[us]")
    rows["big"] = 2**53 - numpy.arange(ROWS)
    numpy.save(folder / "fields.npy", rows)
    columns = {"t": rows["t"], "pose.x": rows["pose"]["x"], "pose.y": rows["pose"]["y"]}
    columns |= {f"q[{k}]": rows["q"][:, k] for k in range(4)}
    tell("fields.npy", columns | {key: rows[key] for key in ("name", "code", "on", "stamp", "big")})

    arrays = {
        "t": t,
        "v": table,
        "arms": rng.integers(0, 255, (ROWS, 2, 2), dtype="u1"),
        "label": numpy.array(["left", "right"])[rng.integers(0, 2, ROWS)],
        "gain": numpy.float64(1.5),
        "short": numpy.arange(5),
    }
    columns = {"t": t, "label": arrays["label"]} | {f"v[{k}]": table[:, k] for k in range(3)}
    columns |= {f"arms[{i}][{j}]": arrays["arms"][:, i, j] for i in range(2) for j in range(2)}
    numpy.savez(folder / "stored.npz", **arrays)
    tell("stored.npz", columns)
    numpy.savez_compressed(folder / "deflated.npz", **arrays)
    tell("deflated.npz", columns)

    variables = {
        "t": t,
        "wide": table.T,
        "counts": rng.integers(-(2**31), 2**31, (ROWS, 1), dtype="i4"),
        "on": rng.random(ROWS) < 0.5,
        "log": {"imu": {"gyro": table.astype("f4"), "ok": numpy.arange(ROWS, dtype="u2")}, "title": "a text", "dt": 0.01},
        "mass": 2.5,
        "cells": numpy.array([1, "a"], dtype=object),
        "inertia": numpy.eye(3),
    }
    columns = {"t": t, "counts": variables["counts"][:, 0], "on": variables["on"]} | {f"wide[{k}]": table[:, k] for k in range(3)}
    columns |= {f"log.imu.gyro[{k}]": table[:, k].astype("f4") for k in range(3)} | {"log.imu.ok": variables["log"]["imu"]["ok"]}
    for name, packed in (("plain.mat", False), ("packed.mat", True)):
        savemat(folder / name, variables, do_compression=packed, oned_as="column")
        tell(name, columns)
    savemat(folder / "old.mat", {"t": t}, format="4")


if __name__ == "__main__":
    main()
