"""k-means: exact Lloyd's algorithm, with the same result on any number of threads."""

from __future__ import annotations

import warnings
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ._base import (
    HAS_SKLEARN,
    BaseEstimator,
    ClusterMixin,
    ConvergenceWarning,
    TransformerMixin,
    check_is_fitted,
    check_weight,
    check_x,
    is_sparse,
)
from ._core import KMeansPoints, kmeans_assign, kmeans_distances, kmeans_draws
from ._params import ARRAY, BOOLEAN, RANDOM_STATE, VERBOSE, Rule, check_params, integer, one_of, real

__all__ = ["KMeans"]

#: Starts where `n_init="auto"` and each start is another one.
_RANDOM_STARTS = 10


class KMeans(TransformerMixin, ClusterMixin, BaseEstimator):
    """k-means clustering.

    Minimises the inertia, the (weighted) sum of the squared distances of all rows to their nearest centres, by
    Lloyd's iterations. Bounds on the distances skip unnecessary work; labels are those of the plain algorithm.
    Parameters and use of `random_state` are those of `sklearn.cluster.KMeans`: equal arguments give equal centres, to
    rounding.

    While `fit` runs it keeps a copy of the rows in its layout: 8 bytes per value, also for `float32`. Sparse rows are
    read block by block and kept dense.

    Parameters
    ----------
    n_clusters : int, default=8
        Number of clusters.
    init : {'k-means++', 'random'}, callable or array-like of shape (n_clusters, n_features), default='k-means++'
        Start of the centres: rows drawn by greedy k-means++, rows drawn evenly, the result of
        ``init(X, n_clusters, random_state=...)`` (X not centred), or this array.
    n_init : int or 'auto', default='auto'
        Number of starts; the one with the least inertia is kept. 'auto': 10 for 'random' and callables, else 1.
    max_iter : int, default=300
        Largest number of iterations of each start.
    tol : float, default=1e-4
        The iteration ends when the squared shifts of the centres sum up to at most this times the mean variance of the
        features.
    verbose : int, default=0
        Print the inertia of each iteration, which costs a pass over the rows.
    random_state : int, RandomState, Generator or None, default=None
        Random numbers of the starts.
    copy_x : bool, default=True
        Accepted without effect: X is never written.
    algorithm : {'lloyd', 'elkan'}, default='lloyd'
        Accepted without effect: both give the same result.

    Attributes
    ----------
    cluster_centers_ : ndarray of shape (n_clusters, n_features)
        The centres, in the type of X (`float32` or `float64`) and the units of the features.
    labels_ : ndarray of shape (n_samples,), int32
        Nearest centre of each row, the first of equally near ones: ``predict`` of the training rows.
    inertia_ : float
        The weighted sum of squared distances: ``-score`` of the training rows.
    n_iter_ : int
        Iterations of the best start.
    n_features_in_ : int
        Number of features.
    feature_names_in_ : ndarray of shape ``(n_features_in_,)``
        Names of the features, if X has names.

    Notes
    -----
    A cluster that loses all its rows restarts at the row farthest from its centre, several at the farthest rows in
    turn. Unlike in scikit-learn, the only row of a cluster and rows of weight zero are excluded.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.array([[1.0, 2.0], [1.0, 4.0], [1.0, 0.0], [10.0, 2.0], [10.0, 4.0], [10.0, 0.0]])
    >>> model = ff.KMeans(n_clusters=2, init=X[[0, 3]]).fit(X)
    >>> model.labels_
    array([0, 0, 0, 1, 1, 1], dtype=int32)
    >>> model.cluster_centers_
    array([[ 1.,  2.],
           [10.,  2.]])
    >>> model.predict([[0.0, 0.0], [12.0, 3.0]])
    array([0, 1], dtype=int32)
    """

    cluster_centers_: NDArray[Any]
    labels_: NDArray[np.int32]
    inertia_: float
    n_iter_: int
    n_features_in_: int

    _rules: dict[str, tuple[Rule, ...]] = {
        "n_clusters": (integer(1),),
        "init": (one_of("k-means++", "random"), Rule("a callable", callable), ARRAY),
        "n_init": (one_of("auto"), integer(1)),
        "max_iter": (integer(1),),
        "tol": (real(0.0),),
        "verbose": (VERBOSE,),
        "random_state": (RANDOM_STATE,),
        "copy_x": (BOOLEAN,),
        "algorithm": (one_of("lloyd", "elkan"),),
    }

    def __init__(
        self,
        n_clusters: int = 8,
        *,
        init: Any = "k-means++",
        n_init: int | Literal["auto"] = "auto",
        max_iter: int = 300,
        tol: float = 1e-4,
        verbose: int = 0,
        random_state: Any = None,
        copy_x: bool = True,
        algorithm: Literal["lloyd", "elkan"] = "lloyd",
    ) -> None:
        self.n_clusters = n_clusters
        self.init = init
        self.n_init = n_init
        self.max_iter = max_iter
        self.tol = tol
        self.verbose = verbose
        self.random_state = random_state
        self.copy_x = copy_x
        self.algorithm = algorithm

    if HAS_SKLEARN:

        def __sklearn_tags__(self) -> Any:
            """scikit-learn's description of the estimator."""
            tags = super().__sklearn_tags__()  # type: ignore[misc, unused-ignore]
            tags.input_tags.sparse = True
            return tags

    def fit(self, X: Any, y: Any = None, sample_weight: Any = None) -> KMeans:
        """Finds the centres.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Finite rows. `float32` and `float64` are read without a copy of the whole array.
        y : None
            Not used.
        sample_weight : array-like of shape (n_samples,), default=None
            A row of weight w counts as w equal rows. Given starts do not depend on it.

        Returns
        -------
        KMeans
            Itself.

        Raises
        ------
        ValueError
            A parameter is out of range, there are fewer rows than clusters, a start has a wrong shape, or values are
            not finite.
        """
        check_params(self, self._rules)
        X = check_x(self, X, reset=True, sparse=True)
        weight = check_weight(sample_weight, X.shape[0])
        self._n_init = self._starts(X.shape[0])
        given = None if isinstance(self.init, str) or callable(self.init) else self._checked_centers(X, self.init)
        random = _Random(self.random_state)
        points = KMeansPoints(X, weight)
        best: tuple[NDArray[np.float64], float, int] | None = None
        for _ in range(self._n_init):
            start = self._start(X, points, weight, random) if given is None else given
            centers, inertia, iterations = self._run(points, start)
            if best is None or (inertia < best[1] and not _same_clusters(centers, best[0])):
                best = centers, inertia, iterations
        assert best is not None
        self.cluster_centers_ = best[0].astype(X.dtype, copy=False)
        self._n_features_out = self.n_clusters
        self.labels_, counts, self.inertia_ = kmeans_assign(X, self._centers(), weight)
        self.n_iter_ = best[2]
        filled = int(np.count_nonzero(counts))
        if filled < self.n_clusters:
            warnings.warn(
                f"Number of distinct clusters ({filled}) found smaller than n_clusters ({self.n_clusters}). "
                "Possibly due to duplicate points in X.",
                ConvergenceWarning,
                stacklevel=2,
            )
        return self

    def fit_predict(  # type: ignore[override]
        self, X: Any, y: Any = None, sample_weight: Any = None
    ) -> NDArray[np.int32]:
        """Fits, and returns `labels_` of shape (n_samples,)."""
        return self.fit(X, sample_weight=sample_weight).labels_

    def fit_transform(  # type: ignore[override]
        self, X: Any, y: Any = None, sample_weight: Any = None
    ) -> NDArray[Any]:
        """Fits, and returns `transform` of the same rows, of shape (n_samples, n_clusters)."""
        return self.fit(X, sample_weight=sample_weight).transform(X)

    def predict(self, X: Any) -> NDArray[np.int32]:
        """The nearest centre of each row.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Rows.

        Returns
        -------
        ndarray of shape (n_samples,), int32
            Numbers of the centres, from 0.
        """
        check_is_fitted(self)
        return kmeans_assign(check_x(self, X, reset=False, sparse=True), self._centers())[0]

    def transform(self, X: Any) -> NDArray[Any]:
        """Distances of each row to all centres.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Rows.

        Returns
        -------
        ndarray of shape (n_samples, n_clusters)
            Euclidean distances, in the type of X.
        """
        check_is_fitted(self)
        X = check_x(self, X, reset=False, sparse=True)
        return kmeans_distances(X, self._centers()).astype(X.dtype, copy=False)

    def score(self, X: Any, y: Any = None, sample_weight: Any = None) -> float:
        """Minus the inertia of rows: the weighted sum of squared distances to their nearest centres.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Rows.
        y : None
            Not used.
        sample_weight : array-like of shape (n_samples,), default=None
            Weights of the rows.

        Returns
        -------
        float
            At most 0.
        """
        check_is_fitted(self)
        X = check_x(self, X, reset=False, sparse=True)
        return -kmeans_assign(X, self._centers(), check_weight(sample_weight, X.shape[0]))[2]

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[np.object_]:
        """Names of the columns of `transform`: 'kmeans0', 'kmeans1' and so on. `input_features` is not used."""
        check_is_fitted(self)
        prefix = type(self).__name__.lower()
        return np.asarray([f"{prefix}{k}" for k in range(len(self.cluster_centers_))], dtype=object)

    def _centers(self) -> NDArray[np.float64]:
        return np.ascontiguousarray(self.cluster_centers_, dtype=np.float64)

    def _starts(self, rows: int) -> int:
        if rows < self.n_clusters:
            raise ValueError(f"n_samples={rows} should be >= n_clusters={self.n_clusters}.")
        if self.algorithm == "elkan" and self.n_clusters == 1:
            warnings.warn(
                "algorithm='elkan' doesn't make sense for a single cluster. Using 'lloyd' instead.",
                RuntimeWarning,
                stacklevel=3,
            )
        drawn = isinstance(self.init, str) or callable(self.init)
        if self.n_init == "auto":
            again = callable(self.init) or (isinstance(self.init, str) and self.init == "random")
            return _RANDOM_STARTS if again else 1
        if not drawn and self.n_init != 1:
            warnings.warn(
                "Explicit initial center position passed: performing only one init in "
                f"{type(self).__name__} instead of n_init={self.n_init}.",
                RuntimeWarning,
                stacklevel=3,
            )
            return 1
        return int(self.n_init)

    def _checked_centers(self, X: NDArray[Any], centers: Any) -> NDArray[np.float64]:
        """Given centres as a matrix of the right shape."""
        checked = np.array(centers, dtype=X.dtype).astype(np.float64)
        if checked.ndim != 2 or checked.shape[0] != self.n_clusters:
            raise ValueError(
                f"The shape of the initial centers {checked.shape} does not match the number of clusters "
                f"{self.n_clusters}."
            )
        if checked.shape[1] != X.shape[1]:
            raise ValueError(
                f"The shape of the initial centers {checked.shape} does not match the number of features of the data "
                f"{X.shape[1]}."
            )
        if not np.isfinite(checked).all():
            raise ValueError("init contains NaN or infinity: centres lie somewhere")
        return checked

    def _start(
        self, X: NDArray[Any], points: KMeansPoints, weight: NDArray[np.float64] | None, random: _Random
    ) -> NDArray[np.float64]:
        """Centres of one start."""
        if callable(self.init):
            return self._checked_centers(X, self.init(X, self.n_clusters, random_state=random.state))
        if self.init == "random":
            count = X.shape[0]
            share = np.full(count, 1.0 / count) if weight is None else weight / weight.sum()
            rows = X[random.state.choice(count, size=self.n_clusters, replace=False, p=share)]
            return np.asarray(rows.toarray() if is_sparse(rows) else rows, dtype=np.float64)
        return points.plus_plus(self.n_clusters, random.uniform(kmeans_draws(self.n_clusters)))

    def _run(self, points: KMeansPoints, start: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, int]:
        """One run: centres, inertia, iterations."""
        verbose = bool(self.verbose)
        if verbose:
            print("Initialization complete")
        centers, inertia, iterations, converged, threshold, steps = points.run(
            start, self.max_iter, float(self.tol), verbose
        )
        for number, (value, changed, shift) in enumerate(steps):
            print(f"Iteration {number}, inertia {value}.")
            if converged and number + 1 == iterations:
                why = "strict convergence" if changed == 0 else f"center shift {shift} within tolerance {threshold}"
                print(f"Converged at iteration {number}: {why}.")
        return centers, inertia, iterations


class _Random:
    """Random numbers in scikit-learn's order."""

    def __init__(self, random_state: Any) -> None:
        if random_state is None or random_state is np.random:
            random_state = np.random.mtrand._rand
        if isinstance(random_state, (int, np.integer)):
            random_state = np.random.RandomState(int(random_state))
        self.state: Any = random_state

    def uniform(self, count: int) -> NDArray[np.float64]:
        draws: NDArray[np.float64] = self.state.uniform(size=count)
        return draws


def _same_clusters(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """True for equal centres in any order, to rounding."""
    order = [np.lexsort(centers.T) for centers in (a, b)]
    scale = np.ptp(a, axis=0).max(initial=0.0)
    return bool(np.allclose(a[order[0]], b[order[1]], rtol=1e-12, atol=1e-12 * scale))
