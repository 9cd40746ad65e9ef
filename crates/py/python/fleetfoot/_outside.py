"""Files that other packages read: HDF5 and MATLAB 7.3 by h5py, Arrow files by pyarrow."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from ._warnings import warn
from .exceptions import DataError

_HDF5 = (".h5", ".hdf5", ".hdf", ".he5")
_ARROW = (".arrow", ".feather", ".arrows", ".ipc")
#: Names that a warning lists.
_LISTED = 8


def is_outside(path: Any) -> bool:
    """True if another package reads the file of a path."""
    path = os.fspath(path)
    ending = os.path.splitext(path)[1].lower()
    return os.path.isfile(path) and (ending in _HDF5 or ending in _ARROW or (ending == ".mat" and _is_hdf5(path)))


def read(path: Any) -> Any:
    """A file as an Arrow table, or as a mapping from columns to arrays.

    Raises
    ------
    DataError
        The package that reads it is missing, or the file is damaged or without rows.
    """
    path = os.fspath(path)
    ending = os.path.splitext(path)[1].lower()
    return _arrow(path) if ending in _ARROW else _arrays(path, matlab=ending == ".mat")


def _is_hdf5(path: str) -> bool:
    """True if a file is HDF5, with or without the 512 bytes of MATLAB's head."""
    with open(path, "rb") as file:
        start = file.read(520)
    return b"\x89HDF\r\n\x1a\n" in (start[:8], start[512:])


def _missing(path: str, package: str, kind: str) -> DataError:
    return DataError(f"{path}: {kind} is read by the package {package}: `pip install {package}`")


def _arrow(path: str) -> Any:
    """An Arrow file (Feather), of either version, or a stream."""
    try:
        import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
        from pyarrow import feather
    except ImportError:
        raise _missing(path, "pyarrow", "Arrow") from None
    try:
        with open(path, "rb") as file:
            start = file.read(6)
        if start.startswith((b"FEA1", b"ARROW1")):
            table = feather.read_table(path)
        else:
            with pa.memory_map(path) as file:
                table = pa.ipc.open_stream(file).read_all()
        # Names that are no text, and offsets beyond their buffers.
        table.schema.names  # noqa: B018
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError) as problem:
        raise DataError(f"{path}: it is no sound Arrow file: {problem}; write it again") from problem
    if not table.num_rows:
        raise DataError(f"{path} has no rows: leave it out")
    return table


def _arrays(path: str, *, matlab: bool) -> dict[str, np.ndarray]:
    """The arrays of an HDF5 file that have as many rows as most others, by their paths.

    MATLAB writes the transpose of its matrices, and marks texts.
    """
    try:
        import h5py  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise _missing(path, "h5py", "a MATLAB file of version 7.3" if matlab else "HDF5") from None
    try:
        with h5py.File(path, "r") as file:
            datasets = dict(_datasets(file, "", matlab))
    except (OSError, RuntimeError, KeyError, ValueError) as problem:
        raise DataError(f"{path}: it is no sound HDF5 file: {problem}; write it again") from problem
    others = [name for name, array in datasets.items() if array is None]
    arrays = {name: array for name, array in datasets.items() if array is not None and array.ndim and array.size}
    if matlab:
        arrays = {name: array.ravel() if 1 in array.shape else array for name, array in arrays.items()}
    lengths = Counter(len(array) for array in arrays.values() if len(array) > 1)
    if not lengths:
        raise DataError(f"{path} has no arrays of numbers with several rows: leave it out")
    rows = max(lengths, key=lambda length: (lengths[length], length))
    short = [name for name, array in arrays.items() if len(array) != rows]
    for names, why in ((short, f"they have other lengths than {rows} rows"), (others, "they are no numbers")):
        if names:
            more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
            warn(f"{path}: left out, because {why}: {', '.join(names[:_LISTED])}{more}")
    columns: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        if len(array) == rows:
            columns.update(_elements(name, array))
    return columns


def _datasets(group: Any, prefix: str, matlab: bool) -> Iterator[tuple[str, np.ndarray | None]]:
    """Arrays of numbers by path, and None for what is none."""
    import h5py

    for key, item in group.items():
        # MATLAB keeps there what cells refer to.
        if key in ("#refs#", "#subsystem#"):
            continue
        name = f"{prefix}.{key}" if prefix else key
        if isinstance(item, h5py.Group):
            yield from _datasets(item, name, matlab)
            continue
        if not isinstance(item, h5py.Dataset):
            continue
        is_text = matlab and item.attrs.get("MATLAB_class") in (b"char", "char", b"cell", "cell")
        if item.shape is None or is_text or item.attrs.get("MATLAB_empty", 0):
            yield name, None
            continue
        if item.dtype.names:
            rows = item[()]
            for field in item.dtype.names:
                yield f"{name}.{field}", _numbers(rows[field], item.shape)
            continue
        is_number = item.dtype.kind in "biuf"
        array = item[()] if is_number else None
        yield name, array.T if array is not None and matlab else array


def _numbers(values: np.ndarray, rows: tuple[int, ...]) -> np.ndarray | None:
    return values if values.dtype.kind in "biuf" and len(rows) == 1 else None


def _elements(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """A column for each element of what a row holds: ``v``, or ``v[0]``, ``v[1]``."""
    for index in np.ndindex(*array.shape[1:]):
        yield name + "".join(f"[{place}]" for place in index), array[(slice(None), *index)]
