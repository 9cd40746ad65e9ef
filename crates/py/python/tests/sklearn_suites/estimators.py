"""Expected failures of `check_estimator`: by class the checks that fail or do not apply, with their reasons."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_REGIONS = "equal rows are drawn more often as starts of k-means: other regions, as in scikit-learn's KMeans"
_AT_ONCE = "pysindy's optimizers refuse a bad parameter when it is given, and so do these"
_OPTIMIZER = {"check_do_not_raise_errors_in_init_or_set_params": _AT_ONCE}

_CLOCK = "the second argument is t, as in pysindy; by position it is y where the clock is told otherwise, as here by target"
_VECTOR = "a run of one state may be a vector"
_IDENTIFIER = {"check_fit_score_takes_y": _CLOCK, "check_fit1d": _VECTOR}
_FEW = {"check_fit2d_1sample": "says how many rows it takes, in words of its own"}

#: Checks that fail, by class and check.
EXPECTED: dict[str, dict[str, str]] = {
    "Bolasso": {
        "check_sample_weight_equivalence_on_dense_data": (
            "a row of weight 2 is drawn as one row, two equal rows are drawn each on its own: the replicates differ"
        ),
    },
    # -- identification
    "BlockSparse": _IDENTIFIER,
    "Network": {**_IDENTIFIER, **_FEW},
    "PWA": {**_IDENTIFIER, **_FEW},
    "SINDy": {**_IDENTIFIER, **_FEW},
    # -- clusters and thresholds
    "FROLS": _OPTIMIZER,
    "KMeans": {
        "check_sample_weight_equivalence_on_dense_data": _REGIONS,
        "check_sample_weight_equivalence_on_sparse_data": _REGIONS,
    },
    "PWARegressor": {
        "check_regressor_multioutput": "refuses fewer rows than features + 2: 11 rows of 10 features",
        "check_sample_weight_equivalence_on_dense_data": _REGIONS,
    },
    "SR3": _OPTIMIZER,
    "STLSQ": _OPTIMIZER,
}

#: Constructors of estimators whose defaults do not suit the checks.
MAKE: dict[str, Callable[[Any], Any]] = {
    "BlockSparse": lambda estimator: estimator(target="y", select="bic"),
    "Network": lambda estimator: estimator(target="y", effort="low"),
    "PWA": lambda estimator: estimator(["average", 2], target="y"),
    "SINDy": lambda estimator: estimator(target="y", library="poly(1)"),
}

#: Estimators to which the checks do not apply, with the reason.
OTHERS: dict[str, str] = {
    "Parameters": "estimates numbers of equations that are given: without `known` there is nothing to fit to any X",
    "NARX": "predicts the next value of every column of X from its past: rows depend on their neighbours, and y on all columns",
}
