"""Comparison of models on the same rows, with intervals for their differences."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from . import _core, plot
from ._data import Dataset
from ._data import open as open_data
from ._html import of_comparison
from ._progress import Progress, reporting
from ._warnings import tell_all

Array = Any


@dataclass(frozen=True)
class Comparison:
    """One-step errors of several models on the same rows. Made by :func:`fleetfoot.compare`; prints as a table.

    Attributes
    ----------
    models : tuple of str
        Names, the reference first, then the other models, then the baselines ``null`` and ``persistence``.
    reference : str
        The reference model of the differences.
    targets : tuple of str
        Names of the targets.
    units : dict
        Unit of each target's error; ``None`` if unknown.
    groups : tuple of str
        Names of the episodes (or of the recordings, ``by="recording"``) that have rows.
    rows : array of int, shape (groups,)
        Compared rows of each group.
    rmse : dict
        For each model the RMSE, shape (groups, targets).
    table : list of dict
        For each model and target: ``model``, ``target``, ``rmse`` (mean over the groups), ``low``, ``high`` (95 %
        interval of that mean), ``difference`` (mean over the groups of its error minus the reference's in the same
        group), ``difference_low``, ``difference_high`` and ``better`` (the share of the groups in which it beats the
        reference). NaN for too few groups, and for the reference.
    excluded : int
        Rows left out of all models because a target or a prediction of one of them is missing.
    in_sample : dict
        For each model the groups of its training episodes, where its error is in-sample.
    notes : list of str
        The measured targets, if the models were fitted to different differences of the same states.
    """

    models: tuple[str, ...]
    reference: str
    targets: tuple[str, ...]
    units: dict[str, str | None]
    groups: tuple[str, ...]
    rows: Array
    rmse: dict[str, Array]
    table: list[dict[str, Any]]
    excluded: int
    by: str
    in_sample: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def to_markdown(self) -> str:
        """The table in Markdown."""
        header, lines = self._cells(" ± ")
        rule = ["---"] + ["---:"] * (len(header) - 1)
        rows = [header, rule, *lines]
        return "\n".join("| " + " | ".join(row) + " |" for row in rows)

    def to_latex(self) -> str:
        """The table as a ``tabular`` of LaTeX (booktabs)."""
        header, lines = self._cells(r" $\pm$ ", _tex)
        body = [" & ".join(row) + r" \\" for row in lines]
        columns = "l" + "r" * (len(header) - 1)
        top = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", " & ".join(header) + r" \\", r"\midrule"]
        return "\n".join([*top, *body, r"\bottomrule", r"\end{tabular}"])

    def __str__(self) -> str:
        header, lines = self._cells(" ± ")
        widths = [max(len(row[i]) for row in [header, *lines]) for i in range(len(header))]
        text = [
            "  ".join(cell.ljust(w) if not i else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths)))
            for row in [header, *lines]
        ]
        text.append(self._below())
        text += [f"in-sample: {name} was trained on {len(used)} of these" for name, used in self.in_sample.items() if used]
        return "\n".join(text + self.notes)

    def _below(self) -> str:
        """The caption below the table."""
        rows = int(self.rows.sum())
        return (
            f"one-step RMSE, mean over {len(self.groups)} {self.by}s ({rows} rows; {self.excluded} left out of all) "
            f"with 95 % intervals; differences are to {self.reference}, paired by {self.by}"
        )

    def plot(self, target: str | None = None, *, ax: Any = None) -> Any:
        """Errors of all models with their intervals, by matplotlib: :func:`fleetfoot.plot.comparison`."""
        return plot.comparison(self, target=target, ax=ax)

    def cells(self) -> tuple[list[str], list[list[str]]]:
        """Header and lines of the table, as texts."""
        return self._cells(" ± ")

    def _repr_html_(self) -> str:
        return of_comparison(*self.cells(), self._below(), self.notes)

    def _cells(self, between: str, escape: Callable[[str], str] = str) -> tuple[list[str], list[list[str]]]:
        """Header and lines: for each target its error and the difference to the reference."""
        header = ["model"]
        for target in self.targets:
            unit = self.units.get(target)
            header += [f"{target} [{unit}]" if unit else target, "difference"]
        lines = []
        for model in self.models:
            line = [model]
            for row in (row for row in self.table if row["model"] == model):
                line.append(_interval(row["rmse"], row["high"], between, False))
                line.append(_interval(row["difference"], row["difference_high"], between, True))
            lines.append(line)
        wrap = [
            [cell if cell.startswith("$") else escape(cell) if place == 0 else cell for place, cell in enumerate(line)]
            for line in lines
        ]
        return [escape(cell) for cell in header], wrap


def _tex(text: str) -> str:
    return "".join(
        {"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#", "^": r"\^{}"}.get(letter, letter) for letter in text
    )


def _interval(value: float, high: float, between: str, signed: bool) -> str:
    """A value with half its interval, rounded to the interval."""
    if math.isnan(value):
        return ""
    half = high - value
    sign = "+" if signed else ""
    if not math.isfinite(half):
        return f"{value:{sign}.4g}"
    return f"{value:{sign}.4g}{between}{half:.2g}"


def _is_model(model: Any) -> bool:
    return hasattr(model, "to_json") and hasattr(model, "outputs")


def _unwrapped(model: Any) -> Any:
    """The model of a fitted estimator, or the argument."""
    inner = getattr(model, "model_", None)
    return inner if inner is not None and _is_model(inner) else model


def compare(
    models: Mapping[str, Any],
    data: Any,
    *,
    by: Literal["episode", "recording"] = "episode",
    recipe: Any = None,
    reference: str | None = None,
    progress: Progress = None,
) -> Comparison:
    """Compares models row by row: one-step errors by episode, and paired differences with 95 % intervals across
    episodes.

    All models are scored on the same rows: those with measured targets and a finite prediction of every model and
    persistence. Intervals are Student's t over the episodes, which count as independent; rows within an episode do
    not.

    Parameters
    ----------
    models : dict
        Names and models: :class:`fleetfoot.Model`, fitted estimators with ``model_``, or functions ``f(x, u)`` of the
        states, shape (rows, states), and the inputs, shape (rows, inputs), of an episode's consecutive rows,
        returning predictions of shape (rows, targets), or (rows,) for one target. At least one must be a model, which
        defines states, inputs and targets.
    data : path, table, array, Dataset, ...
        As in :func:`fleetfoot.open`. Use held-out rows; training episodes are listed in ``in_sample``.
    by : {"episode", "recording"}
        Groups of the pairs and averages: episodes, or files and tables with all their episodes.
    recipe : path, str or mapping, optional
        Changes of clock, topics or labels for these data.
    reference : str, optional
        The reference model of the differences; default: the first.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        No model, an unknown reference, models of different targets, a function with a wrong shape, or no row that all
        can predict.

    Notes
    -----
    The baseline ``null`` predicts the mean of the compared rows; ``persistence`` the target of the previous row.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> rng = np.random.default_rng(0)
    >>> runs = [rng.normal(size=2) * np.exp(-np.arange(200)[:, None] * 0.01) for _ in range(4)]
    >>> model = ff.PWA().fit(runs[:2], dt=0.01, feature_names=["a", "b"]).model_
    >>> names = [{"a": run[:, 0], "b": run[:, 1]} for run in runs[2:]]
    >>> comparison = ff.compare({"affine": model, "decay": lambda x, u: -x}, ff.open(names, dt=0.01))
    >>> comparison.models, comparison.targets
    (('affine', 'decay', 'null', 'persistence'), ('d(a)/dt', 'd(b)/dt'))
    """
    if not models:
        raise ValueError("models is empty; give at least one model")
    if by not in ("episode", "recording"):
        raise ValueError(f'by={by!r}: write "episode" or "recording"')
    named = {str(name): _unwrapped(model) for name, model in models.items()}
    reference = next(iter(named)) if reference is None else reference
    if reference not in named:
        raise ValueError(f"reference={reference!r} is none of the models ({', '.join(named)})")
    for baseline in ("null", "persistence"):
        if baseline in named:
            raise ValueError(f"{baseline!r} is the name of a baseline; call the model otherwise")
    dataset = open_data(data, recipe=recipe)
    candidates = {name: model for name, model in named.items() if _is_model(model)}
    if not candidates:
        raise ValueError(
            "models has functions alone; give one fleetfoot model as well, which says what the targets are and how "
            "they are measured"
        )
    for name, model in named.items():
        if name not in candidates and not callable(model):
            raise TypeError(f"models[{name!r}] is a {type(model).__name__}; give a model, or a function of (x, u)")
    by_model, notes = _rows_of(candidates, dataset, progress)
    tell_all(notes)
    first = next(iter(by_model.values()))
    predictions = {name: rows["predicted"] for name, rows in by_model.items()}
    for name, model in named.items():
        if name not in candidates:
            predictions[name] = _call(name, model, first)
    ordered = [reference] + [name for name in named if name != reference]
    return replace(_compared(ordered, predictions, first, by_model, by), notes=notes)


def _rows_of(
    candidates: dict[str, Any], dataset: Dataset, progress: Progress
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Predictions of each model for the same targets, and the measured targets if the models differ in them."""
    reports: dict[str, dict[str, Any]] = {}
    notes: list[str] = []
    for name, model in candidates.items():
        with reporting(progress) as callback:
            rows = _core.read_model_rows(model.to_json(), dataset._core, dataset.recipe, callback)
        if reports:
            first_name, first = next(iter(reports.items()))
            if rows["targets"] != first["targets"]:
                raise ValueError(
                    f"{name} predicts {', '.join(rows['targets'])}, but {first_name} {', '.join(first['targets'])}; "
                    "compare models of the same targets"
                )
            if not _agree(rows, first):
                if len(rows["episode"]) != len(first["episode"]) or not _are_differences(model, candidates[first_name]):
                    raise ValueError(
                        f"{name} and {first_name} measure their targets otherwise; fit both from the same recipe"
                    )
                notes.append(f"{name} was fitted to other differences; its targets are measured as {first_name} has them")
                rows["measured"] = first["measured"]
        reports[name] = rows
    return reports, notes


def _agree(rows: dict[str, Any], first: dict[str, Any]) -> bool:
    """True if two models measure their targets alike, apart from rows at borders."""
    if len(rows["episode"]) != len(first["episode"]):
        return False
    both = np.isfinite(rows["measured"]) & np.isfinite(first["measured"])
    return bool(np.allclose(rows["measured"][both], first["measured"][both], rtol=1e-9, atol=1e-12))


def _are_differences(*models: Any) -> bool:
    """True if all targets are differences of their states, with any number of neighbours."""
    for model in models:
        for equation in model.content.fitted():
            words = set(re.findall(r"`[^`]*`|[A-Za-z_]\w*", equation["target"])) - {"lead", "lag", "time"}
            subject = equation["subject"].strip("`")
            if equation["prediction"] != "derivative" or {word.strip("`") for word in words} != {subject}:
                return False
    return True


def _call(name: str, function: Callable[..., Any], rows: dict[str, Any]) -> Array:
    """A function's predictions, episode by episode."""
    columns = rows["columns"].values()
    states = [values for role, values in columns if role == "state"]
    inputs = [values for role, values in columns if role == "input"]
    count, targets = len(rows["episode"]), len(rows["targets"])
    x = np.column_stack(states) if states else np.empty((count, 0))
    u = np.column_stack(inputs) if inputs else np.empty((count, 0))
    out = np.full((count, targets), np.nan)
    for start, end in _spans(rows["episode"]):
        answer = np.asarray(function(x[start:end], u[start:end]), dtype=float)
        if answer.shape == (end - start,) and targets == 1:
            answer = answer[:, None]
        if answer.shape != (end - start, targets):
            raise ValueError(
                f"{name} gives an array of shape {answer.shape} for {end - start} rows of {targets} targets "
                f"({', '.join(rows['targets'])})"
            )
        out[start:end] = answer
    return out


def _spans(episode: Array) -> list[tuple[int, int]]:
    """First and past-the-last row of each episode."""
    borders = np.flatnonzero(np.diff(episode)) + 1
    edges = [0, *borders.tolist(), len(episode)]
    return [(a, b) for a, b in zip(edges, edges[1:]) if a < b]


def _compared(
    ordered: Sequence[str],
    predictions: dict[str, Array],
    rows: dict[str, Any],
    reports: dict[str, dict[str, Any]],
    by: str,
) -> Comparison:
    measured, targets = rows["measured"], tuple(rows["targets"])
    for other in reports.values():
        measured = np.where(np.isfinite(measured), measured, other["measured"])
    before = np.full_like(measured, np.nan)
    for start, end in _spans(rows["episode"]):
        before[start + 1 : end] = measured[start : end - 1]
    all_predictions = {**{name: predictions[name] for name in ordered}, "persistence": before}
    usable = np.isfinite(measured).all(axis=1)
    for values in all_predictions.values():
        usable &= np.isfinite(values).all(axis=1)
    if not usable.any():
        missing = [name for name, values in all_predictions.items() if not np.isfinite(values).all(axis=1).any()]
        whose = f": {', '.join(missing)} predict none" if missing else ""
        raise ValueError(f"no row has a prediction of all models{whose}; give longer episodes")
    all_predictions["null"] = np.broadcast_to(_mean(measured[usable], rows["wrapped"]), measured.shape)
    groups, group = _groups(rows, by)
    counts = np.bincount(group[usable], minlength=len(groups))
    kept = np.flatnonzero(counts)
    names = (*ordered, "null", "persistence")
    rmse = {}
    for name in names:
        error = measured - all_predictions[name]
        for place, wrapped in enumerate(rows["wrapped"]):
            if wrapped:
                error[:, place] = np.angle(np.exp(1j * error[:, place]))
        sums = [
            np.bincount(group[usable], error[usable, place] ** 2, minlength=len(groups))
            for place in range(len(targets))
        ]
        rmse[name] = np.sqrt(np.column_stack(sums)[kept] / counts[kept, None])
    trained = {name: set(report["in_sample"]) for name, report in reports.items()}
    episodes = {name: [label for label in rows["episodes"] if label in labels] for name, labels in trained.items()}
    return Comparison(
        models=names,
        reference=ordered[0],
        targets=targets,
        units={target: _unit(target, rows["units"]) for target in targets},
        groups=tuple(groups[place] for place in kept),
        rows=counts[kept],
        rmse=rmse,
        table=_table(names, ordered[0], targets, rmse),
        excluded=int((~usable).sum()),
        by=by,
        in_sample=episodes,
    )


def _mean(values: Array, wrapped: Sequence[bool]) -> Array:
    """The mean of each target; of angles the direction of the mean."""
    mean = values.mean(axis=0)
    for place, angle in enumerate(wrapped):
        if angle:
            mean[place] = np.angle(np.exp(1j * values[:, place]).mean())
    return mean


def _groups(rows: dict[str, Any], by: str) -> tuple[list[str], Array]:
    """Names of the groups, and the group index of each row."""
    if by == "episode":
        return list(rows["episodes"]), np.asarray(rows["episode"], dtype=np.int64)
    # An episode is called as its recording, with #2 behind when there are several.
    recordings = [name.rsplit("#", 1)[0] if name.rsplit("#", 1)[-1].isdigit() else name for name in rows["episodes"]]
    names = list(dict.fromkeys(recordings))
    place = np.array([names.index(recording) for recording in recordings], dtype=np.int64)
    return names, place[rows["episode"]]


def _unit(target: str, units: dict[str, str | None]) -> str | None:
    """Unit of a target: the state's, or per second for its derivative."""
    for name, unit in units.items():
        if unit is None:
            continue
        if target == f"d({name})/dt":
            return f"{unit}/s"
        if target in (name, f"next({name})", f"delta({name})"):
            return unit
    return None


def _mean_interval(values: Array) -> tuple[float, float, float]:
    """The mean with its 95 % interval; NaN bounds for fewer than two values."""
    count, mean = len(values), float(np.mean(values))
    if count < 2:
        return mean, math.nan, math.nan
    half = _core.student_t_95(count - 1) * float(np.std(values, ddof=1)) / math.sqrt(count)
    return mean, mean - half, mean + half


def _table(
    names: Sequence[str], reference: str, targets: Sequence[str], rmse: dict[str, Array]
) -> list[dict[str, Any]]:
    table = []
    for name in names:
        for place, target in enumerate(targets):
            errors = rmse[name][:, place]
            mean, low, high = _mean_interval(errors)
            row: dict[str, Any] = {"model": name, "target": target, "rmse": mean, "low": low, "high": high}
            if name == reference:
                row.update(difference=math.nan, difference_low=math.nan, difference_high=math.nan, better=math.nan)
            else:
                paired = errors - rmse[reference][:, place]
                mean, low, high = _mean_interval(paired)
                row.update(difference=mean, difference_low=low, difference_high=high, better=float(np.mean(paired < 0)))
            table.append(row)
    return table
