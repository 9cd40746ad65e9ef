"""What `check_estimator` is expected to find: by class the checks that fail or do not apply, with their reasons."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_REGIONS = "equal rows are drawn more often as starts of k-means: other regions, as in scikit-learn's KMeans"
_AT_ONCE = "pysindy's optimizers refuse a bad parameter when it is given, and so do these"
_OPTIMIZER = {"check_do_not_raise_errors_in_init_or_set_params": _AT_ONCE}

#: Checks that fail, by class and check.
EXPECTED: dict[str, dict[str, str]] = {
    "Bolasso": {
        "check_sample_weight_equivalence_on_dense_data": (
            "a row of weight 2 is drawn as one row, two equal rows are drawn each on its own: the replicates differ"
        ),
    },
    # -- clusters and thresholds
    "FROLS": _OPTIMIZER,
    "KMeans": {"check_sample_weight_equivalence_on_dense_data": _REGIONS},
    "PWARegressor": {
        "check_regressor_multioutput": "refuses fewer rows than features + 2: 11 rows of 10 features",
        "check_sample_weight_equivalence_on_dense_data": _REGIONS,
    },
    "SR3": _OPTIMIZER,
    "STLSQ": _OPTIMIZER,
}

#: How to make an estimator for the checks, where its defaults will not do.
MAKE: dict[str, Callable[[Any], Any]] = {}
