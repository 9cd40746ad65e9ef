"""Suggestions for wrong keywords: synonyms of scikit-learn, pysindy and the recipe."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, cast

Call = TypeVar("Call", bound=Callable[..., Any])

#: Words for the same thing. Estimators of arrays have those of scikit-learn, models of recordings those of the recipe.
_SAME = (
    ("seed", "random_state"),
    ("lam", "alpha", "lambda", "lambda_", "lmbda", "reg_weight_lam", "alphas"),
    ("restarts", "starts", "n_init"),
    ("iterations", "max_iterations", "max_kmeans_iter", "max_iter"),
    ("partition", "n_regions", "regions", "n_clusters"),
    ("partition_on", "partition_features"),
    ("select", "selection", "criterion"),
    ("folds", "cv"),
    ("library", "feature_library", "functions"),
    ("terms", "n_terms", "n_nonzero_coefs", "max_iter"),
    ("max_terms", "terms"),
    ("ridge", "alpha", "l2"),
    ("target", "predict", "outputs"),
    ("lags", "delays"),
    ("progress", "verbose"),
    ("n_estimators", "n_models", "replicates"),
    ("differentiation_method", "differentiation"),
    ("normalize", "normalize_columns"),
    ("lags_out", "ylag"),
    ("lags_in", "xlag"),
    ("weight", "weights", "sample_weight"),
)


def meant(word: str, known: Iterable[str]) -> str | None:
    """The right keyword for a wrong one."""
    names = list(known)
    for same in _SAME:
        match = next((name for name in same if name in names), None) if word in same else None
        if match is not None:
            return match
    return next(iter(difflib.get_close_matches(word, names, 1)), None)


def hinting(call: Call, whose: str | None = None) -> Call:
    """A callable whose error for an unknown keyword names the right one."""
    parameters = inspect.signature(call).parameters
    if any(one.kind is inspect.Parameter.VAR_KEYWORD for one in parameters.values()):
        return call

    @functools.wraps(call)
    def checked(*args: Any, **named: Any) -> Any:
        for word in named:
            if word not in parameters:
                near = meant(word, parameters)
                mend = f"did you mean {near}=?" if near else f"there are {', '.join(n for n in parameters if n != 'self')}"
                raise TypeError(f"{whose or call.__name__} has no argument {word!r}; {mend}")
        return call(*args, **named)

    return cast(Call, checked)
