"""Piecewise-affine regression: regions by k-means, refinement, joined cells or trees, with an affine map in each."""

from __future__ import annotations

import warnings
from numbers import Integral
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ._base import (
    BaseEstimator,
    ConvergenceWarning,
    MultiOutputMixin,
    RegressorMixin,
    check_is_fitted,
    check_weight,
    check_x,
    check_xy,
    random_seed,
)
from ._core import PwaFit, pwa_regions
from ._params import ARRAY, BOOLEAN, NONE, RANDOM_STATE, Rule, check_params, integer, one_of, real
from ._requests import PwaRequest, PwaRule

__all__ = ["PWARegressor"]

#: Rows that are predicted at a time.
_BLOCK = 1 << 16


class PWARegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Piecewise-affine regression.

    The space of the features is cut into regions (by default Voronoi cells of k-means centres on standardised
    features), and in each region least squares fits an affine map of the features. Cross-validation compares several
    partitions, and the smallest within one standard error of the best is chosen. After Buchan, Haldane and Fearing,
    "Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot".

    For dynamic models with time, logs, simulation and export, see `PWA`.

    Parameters
    ----------
    n_regions : int or list of int, default=10
        Number of regions; from several numbers cross-validation chooses one.
    partition : str or None, default=None
        Method of the `n_regions` regions; default: k-means.

        - ``"refined"``: linear separators between regions, placed for the best fit of the affine maps.
        - ``"lattice"``: many small cells; neighbours with one common map are joined.
        - ``"tree"``: cuts of single features, ``x[0] < 0.3``; fewer regions if further cuts do not lower the
          criterion.

        Or partitions with their own numbers of regions, instead of `n_regions`: ``"kmeans:10"``, ``"refined:2..20"``,
        ``"lattice:2..50"``, ``"tree:1..6"`` (depth of the tree), ``"zscore:1.5"`` (inside and outside a ball of that
        many standard deviations), ``"zbox:1.5"`` (a box of that half width), ``"average"`` (one region), ``"null"``
        (the mean). From a list one is chosen:
        ``"average,zscore:1.5,kmeans:2,5,10"``.
    partition_features : array-like of int or None, default=None
        Features that define the regions; default: all. The affine maps use all features.
    folds : int, default=5
        Folds of a choice: groups if there are at least as many, else spans of neighbouring rows.
    selection : {'cv', 'bic'}, default='cv'
        Rule that chooses one of several partitions: held-out error, or the Bayesian information criterion.
    shrinkage : float or 'auto', default=0.0
        Pull of each region towards the one-region map, as a number of additional rows on that map; 'auto' by
        cross-validation.
    continuous : bool, default=False
        Maps of neighbouring regions meet at their border, for ``"kmeans"``, ``"refined"`` and ``"tree"``.
    n_init : int, default=1
        Number of starts of k-means; the best is kept.
    max_kmeans_iter : int, default=300
        Largest number of iterations of k-means.
    random_state : int, RandomState, Generator or None, default=0
        Seed of the starts of k-means.

    Attributes
    ----------
    coef_ : ndarray of shape ``(n_regions_, n_targets, n_features)``
        The linear maps, a target's unit over a feature's.
    intercept_ : ndarray of shape ``(n_regions_, n_targets)``
        The constants, in the units of the targets.
    centers_ : ndarray of shape ``(n_regions_, n_partition_features)``, or None
        Centres of the regions, in the units of the features; None unless the partition is by k-means.
    cuts_ : list of tuple, or None
        Cuts of a tree, the root first: feature, threshold in its unit, and the successors below and above the
        threshold, each the number of a cut or ``-1 - region``. None for other partitions.
    labels_ : ndarray of shape (n_samples,), int32
        The region of each training row.
    counts_ : ndarray of shape ``(n_regions_,)``
        Training rows in each region.
    n_regions_ : int
        Number of regions. It is smaller than requested if there are fewer different rows, or if refined regions or
        cuts would not have enough rows.
    partition_ : str
        The chosen partition.
    best_index_ : int
        Index of the chosen partition in `cv_results_`.
    cv_results_ : dict
        For each partition: 'partition', 'n_regions', 'mean_test_loss' and 'std_error' (held-out squared error over
        the variance of the targets, and its standard error over folds), 'split_test_loss' (partitions x folds), 'r2'
        (partitions x targets), 'bic'; losses are NaN without folds. With `continuous` 'mean_test_loss_apart', of
        independent maps.
    n_features_in_ : int
        Number of features.

    Notes
    -----
    A region without rows has the one-region map. If a region's rows do not determine its map, it is the one of least
    norm in standardised units. Weights enter the regressions, refined regions and trees, not the cells of k-means.
    k-means uses all rows up to 512 MB, and a sample of that size beyond; refinement and trees use at most 65,536
    rows.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> x = np.linspace(-1.0, 1.0, 400)
    >>> model = ff.PWARegressor(n_regions=2).fit(x[:, None], np.abs(x))
    >>> print(round(model.score(x[:, None], np.abs(x)), 6))
    1.0
    >>> np.sort(model.coef_[:, 0, 0]).round(6)
    array([-1.,  1.])
    """

    coef_: NDArray[np.float64]
    intercept_: NDArray[np.float64]
    centers_: NDArray[np.float64] | None
    cuts_: list[tuple[int, float, int, int]] | None
    labels_: NDArray[np.int32]
    counts_: NDArray[np.int64]
    n_regions_: int
    partition_: str
    best_index_: int
    cv_results_: dict[str, Any]
    n_features_in_: int

    _rules: dict[str, tuple[Rule, ...]] = {
        "n_regions": (integer(1), ARRAY),
        "partition": (Rule("a str", lambda value: isinstance(value, str)), NONE),
        "partition_features": (ARRAY, NONE),
        "folds": (integer(2, 65535, "both"),),
        "selection": (one_of("cv", "bic"),),
        "shrinkage": (real(0.0), one_of("auto")),
        "continuous": (BOOLEAN,),
        "n_init": (integer(1),),
        "max_kmeans_iter": (integer(1),),
        "random_state": (RANDOM_STATE,),
    }

    def __init__(
        self,
        n_regions: Any = 10,
        *,
        partition: str | None = None,
        partition_features: Any = None,
        folds: int = 5,
        selection: Literal["cv", "bic"] = "cv",
        shrinkage: float | Literal["auto"] = 0.0,
        continuous: bool = False,
        n_init: int = 1,
        max_kmeans_iter: int = 300,
        random_state: Any = 0,
    ) -> None:
        self.n_regions = n_regions
        self.partition = partition
        self.partition_features = partition_features
        self.folds = folds
        self.selection = selection
        self.shrinkage = shrinkage
        self.continuous = continuous
        self.n_init = n_init
        self.max_kmeans_iter = max_kmeans_iter
        self.random_state = random_state

    def fit(self, X: Any, y: Any, sample_weight: Any = None, groups: Any = None) -> PWARegressor:
        """Finds the regions and their maps.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Features. They are copied only to sort groups whose rows are not neighbours.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets, none of them constant.
        sample_weight : array-like of shape (n_samples,), default=None
            Weights of the rows' squared errors. Their scale has no effect: together they count as the effective
            number of rows, ``sum(w)**2 / sum(w**2)``.
        groups : array-like of shape (n_samples,), default=None
            Groups such as recordings, which folds do not split if there are at least as many groups as folds.

        Returns
        -------
        PWARegressor
            Itself.

        Raises
        ------
        ValueError
            A parameter is out of range, there are too few rows, a target is constant, or values are not finite.
        NotImplementedError
            A partition by labels.
        """
        check_params(self, self._rules)
        X, y = check_xy(self, X, y, multi_output=True, min_samples=2)
        weight = check_weight(sample_weight, len(X))
        self._flat = y.ndim == 1
        order, lengths = _groups(groups, len(X))
        if order is None:
            fit = PwaFit(X, y, weight, self._request(X.shape[1], lengths))
        else:
            sorted_weight = None if weight is None else weight[order]
            fit = PwaFit(X[order], y[order], sorted_weight, self._request(X.shape[1], lengths))
        self._take(fit)
        self.labels_ = self._regions(X)
        self.counts_ = np.bincount(self.labels_, minlength=self.n_regions_)
        for note, unconverged in fit.notes:
            warnings.warn(note, ConvergenceWarning if unconverged else UserWarning, stacklevel=2)
        return self

    def apply(self, X: Any) -> NDArray[np.int32]:
        """The region of each row.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Features.

        Returns
        -------
        ndarray of shape (n_samples,), int32
            Numbers of the regions, from 0.
        """
        check_is_fitted(self)
        return self._regions(check_x(self, X, reset=False))

    def predict(self, X: Any) -> NDArray[np.float64]:
        """Predicts by the affine map of each row's region.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Features.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_targets)
            Predictions, in the units of the targets.
        """
        check_is_fitted(self)
        X = check_x(self, X, reset=False)
        predicted = np.empty((len(X), self.intercept_.shape[1]))
        for first in range(0, len(X), _BLOCK):
            rows = X[first : first + _BLOCK]
            regions = self._regions(rows)
            for region in np.unique(regions):
                chosen = np.flatnonzero(regions == region)
                predicted[first + chosen] = rows[chosen] @ self.coef_[region].T + self.intercept_[region]
        return predicted[:, 0] if self._flat else predicted

    def _regions(self, X: NDArray[Any]) -> NDArray[np.int32]:
        return pwa_regions(X, self._rule)

    def _take(self, fit: PwaFit) -> None:
        """Attributes of the result."""
        self.coef_ = np.asarray(fit.coefficients, dtype=np.float64)
        self.intercept_ = np.asarray(fit.constants, dtype=np.float64)
        self.n_regions_ = len(self.intercept_)
        self.coef_ = self.coef_.reshape(*self.intercept_.shape, -1)
        if self.coef_.shape[2] == 0:
            # The null model's library is empty.
            self.coef_ = np.zeros((*self.intercept_.shape, self.n_features_in_))
        self.partition_ = fit.partition
        (centre, scale), (weights, offsets) = fit.units, fit.separators
        features = self._features(self.n_features_in_) if centre else []
        self._rule: PwaRule = {
            "features": features,
            "centre": centre,
            "scale": scale,
            "weights": weights,
            "offsets": offsets,
            "joined": fit.joined,
            "cuts": fit.cuts,
            "radius": fit.radius,
            "half": fit.half,
        }
        cuts = [(features[column], threshold, below, above) for column, threshold, below, above in fit.cuts]
        self.cuts_ = cuts or None
        voronoi = bool(weights) and fit.is_voronoi
        self.centers_ = np.asarray(weights) * np.asarray(scale) + np.asarray(centre) if voronoi else None
        names, regions, losses, errors, splits, r2, bic = map(list, zip(*fit.candidates))
        self.cv_results_ = {
            "partition": names,
            "n_regions": np.asarray(regions),
            "mean_test_loss": np.asarray(losses),
            "std_error": np.asarray(errors),
            "split_test_loss": np.asarray(splits, dtype=np.float64),
            "r2": np.asarray(r2),
            "bic": np.asarray(bic),
        }
        if self.continuous:
            self.cv_results_["mean_test_loss_apart"] = np.asarray(fit.apart)
        self.best_index_ = fit.chosen

    def _partitions(self) -> str:
        """The partitions as the engine reads them."""
        if self.partition is not None:
            if "labels" in self.partition:
                raise NotImplementedError(
                    f"partition={self.partition!r}: regions by labels are not supported by PWARegressor; "
                    "fit one for each label, or use PWA"
                )
            if self.partition not in ("kmeans", "refined", "lattice", "tree"):
                return self.partition
        kind = self.partition or "kmeans"
        if isinstance(self.n_regions, Integral):
            return _partition(kind, int(self.n_regions))
        wanted = np.asarray(self.n_regions)
        if wanted.ndim != 1 or not len(wanted) or not np.issubdtype(wanted.dtype, np.integer) or (wanted < 1).any():
            raise ValueError(f"n_regions must be a positive int or a list of them. Got {self.n_regions!r} instead.")
        return ",".join(_partition(kind, int(regions)) for regions in wanted)

    def _features(self, features: int) -> list[int]:
        """Features that define the regions."""
        if self.partition_features is None:
            return list(range(features))
        chosen = np.asarray(self.partition_features)
        if chosen.ndim != 1 or not len(chosen) or not np.issubdtype(chosen.dtype, np.integer):
            raise ValueError("partition_features must be a list of feature numbers, at least one")
        if chosen.min() < 0 or chosen.max() >= features:
            raise ValueError(f"partition_features names features beyond 0 to {features - 1}")
        return [int(feature) for feature in chosen]

    def _request(self, features: int, groups: list[int]) -> PwaRequest:
        partitions = self._partitions()
        choice = "," in partitions or ".." in partitions or self.shrinkage == "auto"
        return {
            "partitions": partitions,
            "features": self._features(features),
            "groups": groups,
            "folds": int(self.folds) if choice else 0,
            "shrinkage": None if self.shrinkage == "auto" else float(self.shrinkage),
            "continuous": bool(self.continuous),
            "bic": self.selection == "bic",
            "seed": random_seed(self.random_state),
            "restarts": int(self.n_init),
            "max_iter": int(self.max_kmeans_iter),
        }


def _partition(kind: str, regions: int) -> str:
    """A partition with this number of regions; a tree has at most two to the power of its depth."""
    if kind != "tree":
        return f"{kind}:{regions}"
    return "average" if regions == 1 else f"tree:{regions.bit_length() - 1}"


def _groups(groups: Any, rows: int) -> tuple[NDArray[np.intp] | None, list[int]]:
    """An order of the rows that puts groups together (None if they already are), and the rows of each group."""
    if groups is None:
        return None, [rows]
    labels = np.asarray(groups)
    if labels.shape != (rows,):
        raise ValueError(f"groups.shape == {labels.shape}, expected {(rows,)}: one label a row")
    borders = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    runs = np.diff(np.concatenate([[0], borders, [rows]]))
    unique, inverse, counts = np.unique(labels, return_inverse=True, return_counts=True)
    if len(unique) == len(runs):
        return None, [int(length) for length in runs]
    return np.argsort(inverse, kind="stable"), [int(count) for count in counts]
