"""Lazy tables of polars, written block by block to a temporary file that streams."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import _core
from ._frames import CLOCKS, frame, is_lazy
from .exceptions import DataError

#: Rows that tell which columns of text or objects are signals.
_SAMPLE = 1000
#: Rows of a group of the file.
_GROUP = 1 << 16


def has_lazy(thing: Any) -> bool:
    """True for a lazy table, or a list of them."""
    if isinstance(thing, (list, tuple)):
        return bool(thing) and all(is_lazy(one) for one in thing)
    return is_lazy(thing)


def spooled(tables: Sequence[Any], names: Sequence[str]) -> _core.Data:
    """Lazy tables as temporary files, deleted with their reader."""
    folder = tempfile.TemporaryDirectory(prefix="fleetfoot-")
    paths = [Path(folder.name) / str(at) / f"{name}.parquet" for at, name in enumerate(names)]
    try:
        for table, path in zip(tables, paths):
            path.parent.mkdir()
            table.sink_parquet(path, compression="lz4", row_group_size=_GROUP)
        data = _core.Data.files([str(path) for path in paths])
    except Exception as error:
        folder.cleanup()
        if isinstance(error, OSError) or type(error).__module__.partition(".")[0] == "polars":
            raise DataError(f"the lazy table cannot be computed: {error}") from error
        raise
    weakref.finalize(data, folder.cleanup)
    return data


def signals(
    data: _core.Data, clock: str | None, left: Sequence[str], *, find_clock: bool
) -> tuple[list[str], str | None]:
    """The signal columns of a lazy table, as for a table in memory, and its clock column."""
    import polars

    table = frame(polars.read_parquet(data.names()[0], n_rows=_SAMPLE))
    assert table is not None
    if clock is None and find_clock:
        clock = next((name for name in CLOCKS if name in table.names), None)
    elif clock is not None and clock not in table.names:
        raise DataError(f"t={clock!r}: the table has no such column; it has {', '.join(table.names)}")
    known = {*left, *([] if clock is None else [clock])}
    # Of numbers no row need be looked at.
    others = table.signals({*known, *table.numbers})
    names = [name for name in table.names if name in others or (name in table.numbers and name not in known)]
    if not names:
        raise DataError(f"the table has no column of numbers beside its clock; it has {', '.join(table.names)}")
    return names, clock

