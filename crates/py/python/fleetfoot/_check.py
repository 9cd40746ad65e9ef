"""Faults of logs before a fit: the command ``check`` in Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from . import _core, _recipe
from ._data import open as open_data
from ._progress import Progress, reporting
from ._warnings import tell_all


@dataclass(frozen=True)
class Finding:
    """A fault in logs.

    Attributes
    ----------
    fault : str
        Kind: ``"jitter"``, ``"dropped"``, ``"dead"``, ``"stuck"``, ``"saturated"``, ``"gross-errors"``, ``"unit"``,
        ``"delay"``, ...
    place : str
        The channel, topic or file.
    what : str
        The measurement, in words.
    value : float
        The measured number: a share, a ratio, seconds.
    mend : str
        The remedy, as a command.
    """

    fault: str
    place: str
    what: str
    value: float
    mend: str


@dataclass(frozen=True)
class Checked:
    """Result of :func:`check`.

    Attributes
    ----------
    findings : list of Finding
        Faults, the most serious first; empty for sound logs.
    channels : list of dict
        For each channel ``name``, ``unit``, ``range``, ``mean``, ``deviation``, and the shares ``missing`` and ``moves``
        of its rows.
    files, episodes, rows : int
        Amount of data read.
    period : float
        Seconds between rows; 0 without a clock.
    """

    findings: list[Finding]
    channels: list[dict[str, Any]]
    files: int
    episodes: int
    rows: int
    period: float

    def __str__(self) -> str:
        lines = [f"{one.place}: {one.what}\n  -> {one.mend}" for one in self.findings]
        return "\n".join(lines) if lines else "Nothing wrong was found."


def check(data: Any, *, recipe: Any = None, progress: Progress = None) -> Checked:
    """Finds faults of logs before a fit: stamps, dead and stuck channels, units, delays.

    Parameters
    ----------
    data : path, list of paths, DataFrame or Dataset
        The logs.
    recipe : path, str or dict, optional
        Recipe whose states and inputs are checked. Default: all columns of tables, and of robots' logs those that
        ``fleetfoot init`` proposes.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    Checked

    Raises
    ------
    DataError
        A file that cannot be read.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(3000) * 0.01
    >>> yaw = np.sin(t) + 0.3 * np.sin(3.1 * t)
    >>> rate = np.degrees(np.cos(t) + 0.93 * np.cos(3.1 * t))
    >>> found = ff.check(ff.open({"t": t, "yaw": yaw, "yaw_rate": rate}, t="t"))
    >>> [(one.fault, one.place) for one in found.findings]
    [('unit', 'yaw_rate')]
    """
    dataset = open_data(data, recipe=recipe)
    text = _recipe.to_json(_recipe.of_toml(dataset.recipe))
    with reporting(progress) as callback:
        checked: dict[str, Any] = _core.check(dataset._core, text, callback)
    tell_all(checked.pop("notes"))
    findings = [Finding(**one) for one in checked.pop("findings")]
    names = ("channels", "files", "episodes", "rows", "period")
    return Checked(findings=findings, **{name: checked[name] for name in names})


__all__ = ["Checked", "Finding", "check"]
