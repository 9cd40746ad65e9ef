"""Reports of models on recordings: dictionaries that print as a table."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from ._html import grid


class Report(dict[str, Any], ABC):
    """A report as a dictionary that prints as a table; for pandas use ``pandas.DataFrame(report.table)``.

    Attributes
    ----------
    table : list of dict
        Its numbers row by row; NaN for missing ones.
    """

    @property
    @abstractmethod
    def table(self) -> list[dict[str, Any]]:
        """The numbers of the report, a dict for each row of its table."""

    @abstractmethod
    def summary(self) -> str:
        """The lines below the table."""

    def _cells(self) -> tuple[list[str], list[list[str]]]:
        rows = self.table
        header = list(rows[0]) if rows else []
        return header, [[_cell(row[name]) for name in header] for row in rows]

    def __repr__(self) -> str:
        try:
            header, lines = self._cells()
            below = self.summary()
        except (KeyError, TypeError, IndexError):
            # Somebody took a part out of it.
            return dict.__repr__(self)
        widths = [max(len(line[at]) for line in [header, *lines]) for at in range(len(header))]
        return "\n".join([*(_line(line, widths) for line in [header, *lines]), below])

    def _repr_html_(self) -> str | None:
        try:
            header, lines = self._cells()
            return grid(header, lines, self.summary())
        except (KeyError, TypeError, IndexError):
            # Notebooks show the text then.
            return None


class Scores(Report):
    """One-step errors: the result of :meth:`fleetfoot.Model.score`."""

    @property
    def table(self) -> list[dict[str, Any]]:
        """For each target its errors, those against raw measurements (for prepared logs), of the null model and of
        persistence."""
        measured = any(one.get("raw") for one in self["targets"])
        return [
            {
                "target": one["name"],
                "unit": one["unit"] or "",
                "rmse": _number(one["rmse"]),
                **({"raw rmse": _number((one.get("raw") or {}).get("rmse"))} if measured else {}),
                "mae": _number(one["mae"]),
                "r2": _number(one["r2"]),
                **{f"rmse of {other['name']}": _number(other["rmse"]) for other in one["baselines"]},
            }
            for one in self["targets"]
        ]

    def summary(self) -> str:
        """Numbers of rows and episodes, and of training episodes."""
        seen = len(self["in_sample_episodes"])
        return f"one step ahead on {self['rows']} rows of {self['episodes']} episodes, {seen} of which trained the model"


class Rollouts(Report):
    """Errors of rollouts: the result of :meth:`fleetfoot.Model.rollout`."""

    @property
    def table(self) -> list[dict[str, Any]]:
        """For each state its error at the last step, those against raw measurements (for prepared logs) and of the
        baselines."""
        raw = {"raw rmse": self["raw"]} if self.get("raw") else {}
        whose = {"rmse": self["model"], **raw, **{f"rmse of {name}": one for name, one in self["baselines"].items()}}
        seconds = self["time"][-1] if self["time"] else None
        return [
            {
                "state": state,
                "after [s]": _number(seconds),
                **{name: _number(one["rmse"][-1][at]) if one["rmse"] else _number(None) for name, one in whose.items()},
            }
            for at, state in enumerate(self["states"])
        ]

    def summary(self) -> str:
        """Number of rollouts, and their ends."""
        return (
            f"{self['rollouts']} rollouts of {len(self['time'])} steps: {self['diverged']} diverged, "
            f"{self['left_domain']} left the training range"
        )


class Filtered(Report):
    """Estimates of a filter: the result of :meth:`fleetfoot.Model.filter`."""

    @property
    def table(self) -> list[dict[str, Any]]:
        """For each sensor its deviation, and the consistency of its innovations."""
        return [
            {
                "state": one["state"],
                "deviation": _number(one["deviation"]),
                "from": one["deviation_from"],
                "within 95 %": _number(one["share"]),
                "correlation": _number(one["correlation"]),
            }
            for one in self["sensors"]
        ]

    def summary(self) -> str:
        """Rows, and the mean squared innovation per degree of freedom."""
        nis = self["nis"] or {}
        return f"{self['rows']} rows of {self['episodes']} episodes; squared innovations {_cell(_number(nis.get('mean')))} (1 is right)"


def _number(value: Any) -> float:
    """A number, the centre of an interval, or NaN."""
    if isinstance(value, dict):
        value = value.get("value")
    return float("nan") if value is None else float(value)


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    return "" if value != value else f"{value:.4g}"


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = [cell.ljust(width) if not at else cell.rjust(width) for at, (cell, width) in enumerate(zip(cells, widths))]
    return "  ".join(padded).rstrip()
