"""Solutions of a statistic."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._model import Model

_RATIOS = {"least-squares": 1.0, "ridge": 0.0, "lasso": 1.0, "elastic-net": None}


class Certificate(NamedTuple):
    """Bound on the distance of coefficients from the minimum, from the statistic alone."""

    #: The largest violation of the Karush-Kuhn-Tucker conditions, as a correlation.
    kkt: float
    #: Bound on objective minus minimum, over the objective of zero coefficients.
    gap: float
    #: The objective.
    objective: float


class TaskScore(NamedTuple):
    """Errors of a task on the rows of the statistic."""

    #: Root mean squared error, in units of the target.
    rms: float
    #: Share of the target's variance that is explained.
    r2: float


@dataclass(frozen=True, eq=False)
class Solution:
    """Coefficients of a statistic. Made by :meth:`fleetfoot.Stats.solve`.

    Attributes
    ----------
    method : str
        ``"least-squares"``, ``"ridge"``, ``"lasso"`` or ``"elastic-net"``.
    names : list of str
        ``"latent: function"`` of every coefficient (p).
    coefficients : ndarray of shape (p,)
        In raw units.
    standard_errors : ndarray of shape (p,) or None
        For least squares, clustered by episode (from ten episodes on, else by chunk); NaN for a left-out column.
    certificate : Certificate
        Bound on the distance from the minimum.
    rows : float
        Sum of the row weights.
    tasks : dict of TaskScore
        Errors on these rows, by task.
    confounded : list of list of str
        Coefficients that the rows cannot separate.
    notes : list of str
        Notes for the user.
    """

    method: str
    names: list[str]
    coefficients: NDArray[np.float64]
    standard_errors: NDArray[np.float64] | None
    certificate: Certificate
    rows: float
    tasks: dict[str, TaskScore]
    confounded: list[list[str]]
    notes: list[str]
    _pairs: list[tuple[str, str]] = field(repr=False)
    _json: str = field(repr=False)

    def as_dict(self) -> dict[str, dict[str, float]]:
        """Coefficients by latent and function."""
        content: dict[str, dict[str, float]] = {}
        for (latent, function), value in zip(self._pairs, self.coefficients, strict=True):
            content.setdefault(latent, {})[function] = float(value)
        return content

    def to_json(self) -> str:
        """The model as JSON, as ``fleetfoot`` writes it to ``model.json``."""
        return self._json

    @property
    def model(self) -> Model:
        """The model with these coefficients."""
        return Model(_core.Model.from_json(self._json, "the solution"))


def strength(method: str, alpha: float | None, l1_ratio: float | None) -> tuple[float | None, float]:
    """The penalty of a method and the share of the absolute values in it; ``None``: least squares."""
    if method not in _RATIOS:
        raise ValueError(f"method = {method!r}: give one of {', '.join(_RATIOS)}")
    ratio = _RATIOS[method]
    if method == "least-squares":
        if alpha is not None:
            raise ValueError(f"alpha = {alpha}: least-squares has no penalty; take ridge, lasso or elastic-net")
    elif alpha is None:
        raise ValueError(f"alpha is not given; {method} needs it")
    if ratio is None:
        if l1_ratio is None:
            raise ValueError("l1_ratio is not given; elastic-net needs it (0: ridge, 1: lasso)")
        ratio = float(l1_ratio)
    elif l1_ratio is not None:
        raise ValueError(f"l1_ratio = {l1_ratio}: {method} has its own; take elastic-net")
    return None if alpha is None else float(alpha), ratio


def solution(method: str, solved: dict[str, Any]) -> Solution:
    """A solution from the engine's result."""
    return Solution(
        method=method,
        names=[f"{latent}: {function}" for latent, function in solved["names"]],
        coefficients=solved["coefficients"],
        standard_errors=solved["standard_errors"],
        certificate=Certificate(*solved["certificate"]),
        rows=solved["rows"],
        tasks={name: TaskScore(rms, r2) for name, rms, r2 in solved["tasks"]},
        confounded=solved["confounded"],
        notes=solved["notes"],
        _pairs=solved["names"],
        _json=solved["model"],
    )
