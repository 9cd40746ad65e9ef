"""Figures of paths and selections: coefficients against the penalty, and selection frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._axes import axes_of, short

#: Lines that are told by name; the rest are grey.
_NAMED = 10


def path(
    estimator: Any,
    *,
    feature_names: Sequence[str] | None = None,
    target: int = 0,
    unit: str | None = None,
    ax: Any = None,
) -> Any:
    """The coefficients along a regularisation path.

    Parameters
    ----------
    estimator : object or tuple
        A fitted estimator with ``alphas_`` and ``coef_path_`` (``Lars``, ``LassoLars``, ...), or the result of
        ``lars_path`` or ``lasso_path``.
    feature_names : list of str, optional
        Names of the features; default: ``feature_names_in_`` of the estimator, else ``x0``, ``x1``, ...
    target : int
        Index of the target, if there are several.
    unit : str, optional
        The coefficients' unit.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError
        The estimator has no path.
    ImportError
        matplotlib is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from fleetfoot import plot
    >>> alphas, coefs = np.array([1.0, 0.5, 0.1]), np.array([[0.0, 0.4, 0.8], [0.0, 0.0, -0.3]])
    >>> plot.path((alphas, coefs)).get_xlabel()
    'alpha (penalty, weaker to the right)'
    """
    alphas, coefs = _path_of(estimator, target)
    names = _names(estimator, feature_names, len(coefs))
    ax = axes_of(ax)
    order = np.argsort(-np.abs(coefs).max(axis=1))
    positive = bool((alphas > 0).any())
    # The last knot of a whole path is zero, which a logarithm has not: it is drawn where the path would go on.
    shown = np.where(alphas > 0, alphas, alphas[alphas > 0].min() / 2) if positive else alphas
    for rank, feature in enumerate(order):
        if not coefs[feature].any():
            continue
        style: dict[str, Any] = (
            {"label": short(names[feature]), "lw": 1.6} if rank < _NAMED else {"color": "0.75", "lw": 0.8, "zorder": 1}
        )
        ax.plot(shown, coefs[feature], **style)
    if positive:
        ax.set_xscale("log")
    ax.invert_xaxis()
    ax.axhline(0.0, color="0.5", lw=0.6)
    ax.set_xlabel("alpha (penalty, weaker to the right)")
    ax.set_ylabel(f"coefficient [{unit}]" if unit else "coefficient")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize="small", frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


def _path_of(estimator: Any, target: int) -> tuple[Any, Any]:
    """Penalties and coefficients (features, penalties) of one target."""
    alphas: Any
    coefs: Any
    if isinstance(estimator, tuple):
        alphas = np.asarray(estimator[0], dtype=float)
        coefs = next((np.asarray(part, dtype=float) for part in estimator[1:] if np.ndim(part) >= 2), None)
    else:
        path: tuple[Any, Any] = getattr(estimator, "alphas_", None), getattr(estimator, "coef_path_", None)
        alphas, coefs = path if not isinstance(path[1], list) else (path[0][target], path[1][target])
    if alphas is None or coefs is None:
        raise TypeError(
            f"{type(estimator).__name__} has no alphas_ and coef_path_: fit it with fit_path=True, or give what "
            "lars_path returns"
        )
    alphas, coefs = np.asarray(alphas, dtype=float), np.asarray(coefs, dtype=float)
    if coefs.ndim == 3:
        coefs = coefs[target]
    if coefs.ndim != 2 or alphas.shape != (coefs.shape[1],):
        raise TypeError(
            f"the path has {alphas.shape} penalties and {coefs.shape} coefficients; give features in rows and "
            "penalties in columns"
        )
    return alphas, coefs


def _names(estimator: Any, names: Sequence[str] | None, count: int) -> list[str]:
    if names is None:
        names = getattr(estimator, "feature_names_in_", None)
    if names is None:
        return [f"x{i}" for i in range(count)]
    if len(names) != count:
        raise ValueError(f"feature_names has {len(names)} names for {count} features")
    return [str(name) for name in names]


def selection_frequency(
    bolasso: Any,
    *,
    feature_names: Sequence[str] | None = None,
    target: int = 0,
    threshold: float | None = None,
    most: int = 30,
    ax: Any = None,
) -> Any:
    """Selection frequency of each feature over the replicates of a bootstrap.

    Parameters
    ----------
    bolasso : object or array
        A fitted estimator with ``selection_frequency_``, or the shares themselves, shape (features,) or (targets,
        features).
    feature_names : list of str, optional
        Names of the features; default: ``feature_names_in_`` of the estimator, else ``x0``, ``x1``, ...
    target : int
        Index of the target, if there are several.
    threshold : float, optional
        The share from which a feature counts as selected, drawn as a line; default: ``threshold`` of the estimator.
    most : int
        Largest number of features shown, the most frequent first.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError
        The estimator has no frequencies.
    ImportError
        matplotlib is not installed.

    Examples
    --------
    >>> from fleetfoot import plot
    >>> ax = plot.selection_frequency([1.0, 0.3, 0.9], feature_names=["v", "w", "v*w"], threshold=0.9)
    >>> [float(bar.get_width()) for bar in ax.patches]
    [1.0, 0.9, 0.3]
    """
    shares = getattr(bolasso, "selection_frequency_", bolasso)
    try:
        shares = np.asarray(shares, dtype=float)
    except (TypeError, ValueError):
        shares = np.empty((0, 0, 0))
    if shares.ndim not in (1, 2):
        raise TypeError(
            f"{type(bolasso).__name__} has no selection_frequency_: fit it, or give the shares of the features"
        )
    shares = shares[target] if shares.ndim == 2 else shares
    names = _names(bolasso, feature_names, len(shares))
    if threshold is None:
        default = getattr(bolasso, "threshold", None)
        threshold = float(default) if isinstance(default, (int, float)) else None
    order = np.argsort(-shares, kind="stable")[: max(1, most)]
    ax = axes_of(ax)
    chosen = shares[order] >= (threshold if threshold is not None else 1.0)
    ax.barh(range(len(order)), shares[order], color=np.where(chosen, "tab:blue", "0.75"))
    ax.set_yticks(range(len(order)), [short(names[place]) for place in order])
    ax.set_ylim(len(order) - 0.4, -0.6)
    if threshold is not None:
        ax.axvline(threshold, color="black", lw=0.8, ls="--", label=f"threshold {threshold:g}")
        ax.legend(fontsize="small", loc="lower right")
    ax.set_xlim(0.0, 1.02)
    ax.set_xlabel("share of replicates that select it")
    return ax
