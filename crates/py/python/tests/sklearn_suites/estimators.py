"""What `check_estimator` is expected to find: by class the checks that fail or do not apply, with their reasons."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

#: Checks that fail, by class and check.
EXPECTED: dict[str, dict[str, str]] = {
    "Bolasso": {
        "check_sample_weight_equivalence_on_dense_data": (
            "a row of weight 2 is drawn as one row, two equal rows are drawn each on its own: the replicates differ"
        ),
    },
}

#: How to make an estimator for the checks, where its defaults will not do.
MAKE: dict[str, Callable[[Any], Any]] = {}
