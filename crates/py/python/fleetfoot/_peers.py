"""Objects of pysindy, by name and content: libraries and optimisers as entries of a recipe.

Every setting of such an object takes effect or is refused.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._symbols import expressions
from .exceptions import RequestError


def _class(thing: Any) -> str:
    return type(thing).__name__


def _refused(thing: Any, what: str, mend: str) -> RequestError:
    return RequestError(f"{_class(thing)} {what}; {mend}")


def _default(thing: Any, name: str, *allowed: Any) -> None:
    """Refuses an unsupported option."""
    value = getattr(thing, name, allowed[0])
    if not any(value is one or value == one for one in allowed):
        raise _refused(thing, f"with {name}={value!r} is not supported", f"leave {name}={allowed[0]!r}")


def library(given: Any) -> list[Any] | None:
    """Items of a library: texts, functions, or a library of pysindy."""
    if given is None:
        return None
    if isinstance(given, str):
        return [given]
    if isinstance(given, Functions) or (callable(given) and not hasattr(given, "transform")):
        return [given if isinstance(given, Functions) else Functions([given])]
    if isinstance(given, (list, tuple)):
        return [item for one in given for item in library(one) or ()]
    name = _class(given)
    if name == "PolynomialLibrary":
        if not getattr(given, "include_interaction", True):
            mend = "write the functions: library=['x^2', 'y^2']"
            raise _refused(given, "without interactions is not supported", mend)
        bias = "" if getattr(given, "include_bias", True) else ", bias=false"
        kind = "interactions" if getattr(given, "interaction_only", False) else "poly"
        return [f"{kind}({int(given.degree)}{bias})"]
    if name == "FourierLibrary":
        _default(given, "include_sin", True)
        _default(given, "include_cos", True)
        return [f"fourier({int(given.n_frequencies)})"]
    if name == "IdentityLibrary":
        return ["identity"]
    if name == "CustomLibrary":
        terms = Functions(list(given.functions), repeats=not given.interaction_only)
        return ["1", terms] if given.include_bias else [terms]
    if name == "ConcatLibrary":
        return [item for one in given.libraries for item in library(one) or ()]
    if name == "TensoredLibrary":
        _default(given, "inputs_per_library", None)
        items = [library(one) or [] for one in given.libraries]
        if any(isinstance(item, Functions) for one in items for item in one):
            raise _refused(given, "with functions of Python is not supported", "write the products: library=['x*y^2']")
        factors = [" + ".join(one) for one in items]
        return ["*".join(f"({factor})" for factor in factors)]
    mend = "write its functions, for example library=['poly(3)', 'sin', 'x*abs(y)']"
    raise _refused(given, "is no library that can be read", mend)


@dataclass(frozen=True)
class Functions:
    """Python functions as candidates, of every choice of their number of variables."""

    functions: list[Callable[..., Any]]
    repeats: bool = False

    def expressions(self, names: Sequence[str]) -> list[str]:
        """Candidates over variables of these names."""
        return [text for one in self.functions for text in expressions(one, names, repeats=self.repeats)]


def optimizer(given: Any) -> dict[str, Any]:
    """Entries of ``[sindy]``: a name, or an optimiser of pysindy or of this package."""
    if given is None:
        return {}
    if isinstance(given, str):
        return {"optimizer": given}
    name = _class(given)
    # The units of pysindy: columns of length 1, a length that grows with the number of rows.
    normalize = "length" if getattr(given, "normalize_columns", False) else False
    if name == "STLSQ":
        _known(given, {"threshold", "alpha", "max_iter", "normalize_columns", "copy_X"})
        return {
            "optimizer": "stlsq",
            "threshold": float(given.threshold),
            "ridge": float(given.alpha),
            "max_iterations": int(given.max_iter),
            "normalize": normalize,
        }
    if name == "FROLS":
        # The ridge is gone once the terms are fitted again without it.
        _known(given, {"kappa", "max_iter", "normalize_columns", "alpha", "copy_X"})
        kappa = getattr(given, "kappa", None)
        return {
            "optimizer": "frols",
            "terms": int(given.max_iter),
            "kappa": 0.0 if kappa is None else float(kappa),
            "normalize": normalize,
        }
    if name == "SR3":
        # Iterated until it stands, whatever max_iter and tol; terms are fitted again, as with unbias=True.
        _known(given, {"reg_weight_lam", "regularizer", "normalize_columns", "copy_X", "unbias"})
        if str(given.regularizer).lower() != "l0" or np.ndim(given.reg_weight_lam):
            raise _refused(given, "with another penalty than one number of l0 is not supported", "leave regularizer='L0'")
        # Coefficients that l0 drops, at nu = 1.
        return {"optimizer": "sr3", "threshold": math.sqrt(2.0 * float(given.reg_weight_lam)), "normalize": normalize}
    if name == "SSR":
        _known(given, {"alpha", "normalize_columns", "copy_X"})
        return {"optimizer": "ssr", "ridge": float(given.alpha), "normalize": normalize}
    if name == "EnsembleOptimizer":
        _known(given, {"bagging", "library_ensemble", "n_models"})
        if given.bagging and given.library_ensemble:
            raise _refused(given, "of rows and functions at once is not supported", "choose one of the two")
        what = "chunks" if given.bagging else "library"
        return {**optimizer(given.opt), "ensemble": f"{what}:{int(given.n_models)}"}
    mend = "name one: optimizer='stlsq', 'sr3', 'ssr', 'frols', 'lasso' or 'ols', with threshold= or terms="
    raise _refused(given, "is no optimiser that can be read", mend)


#: Names of the entries of ``[sindy]`` in optimiser objects.
SAYS = {
    "threshold": "threshold",
    "ridge": "alpha",
    "terms": "max_iter",
    "normalize": "normalize_columns",
    "max_iterations": "max_iter",
    "kappa": "kappa",
    "ensemble": "n_models",
}

#: Arguments of this package for the options of pysindy's optimisers.
_MENDS = {
    "sparse_ind": "name the functions that stay: fixed={'x': ['1']}",
    "initial_guess": "leave initial_guess=None",
    "ridge_kw": "leave ridge_kw=None: the ridge is solved directly",
    "unbias": "leave unbias=True",
    "verbose": "give progress=True to the estimator",
}


def _known(given: Any, effective: set[str]) -> None:
    """Refuses an option without effect that differs from its default."""
    for name, parameter in inspect.signature(type(given).__init__).parameters.items():
        if name == "self" or name in effective or parameter.default is inspect.Parameter.empty:
            continue
        value = getattr(given, name, parameter.default)
        if not (value is parameter.default or _same(value, parameter.default)):
            raise _refused(given, f"with {name}={value!r} is not supported", _MENDS.get(name, f"leave {name} out"))


def _same(value: Any, default: Any) -> bool:
    try:
        return bool(value == default)
    except ValueError:
        # Of arrays, which are no default.
        return False
