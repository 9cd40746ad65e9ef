"""Objects of pysindy, by what they are called and hold: libraries and optimisers in the words of a recipe."""

from __future__ import annotations

from typing import Any

from .exceptions import RequestError


def _class(thing: Any) -> str:
    return type(thing).__name__


def _refused(thing: Any, what: str, mend: str) -> RequestError:
    return RequestError(f"{_class(thing)} {what}; {mend}")


def _default(thing: Any, name: str, *allowed: Any) -> None:
    """Refuses an option that is not as it must be."""
    value = getattr(thing, name, allowed[0])
    if not any(value is one or value == one for one in allowed):
        raise _refused(thing, f"with {name}={value!r} is not supported", f"leave {name}={allowed[0]!r}")


def library(given: Any) -> list[str] | None:
    """Items of a library: texts, or a library of pysindy."""
    if given is None:
        return None
    if isinstance(given, str):
        return [given]
    if isinstance(given, (list, tuple)):
        return [item for one in given for item in library(one) or ()]
    name = _class(given)
    if name == "PolynomialLibrary":
        _default(given, "interaction_only", False)
        if not getattr(given, "include_interaction", True):
            mend = "write the functions: library=['x^2', 'y^2']"
            raise _refused(given, "without interactions is not supported", mend)
        bias = "" if getattr(given, "include_bias", True) else ", bias=false"
        return [f"poly({int(given.degree)}{bias})"]
    if name == "FourierLibrary":
        _default(given, "include_sin", True)
        _default(given, "include_cos", True)
        return [f"fourier({int(given.n_frequencies)})"]
    if name == "IdentityLibrary":
        return ["identity"]
    if name == "ConcatLibrary":
        return [item for one in given.libraries for item in library(one) or ()]
    if name == "TensoredLibrary":
        factors = [" + ".join(library(one) or ()) for one in given.libraries]
        return ["*".join(f"({factor})" for factor in factors)]
    mend = "write its functions, for example library=['poly(3)', 'sin', 'x*abs(y)']"
    raise _refused(given, "is no library that can be read", mend)


def optimizer(given: Any) -> dict[str, Any]:
    """Entries of ``[sindy]``: a name, or an optimiser of pysindy or of this package."""
    if given is None:
        return {}
    if isinstance(given, str):
        return {"optimizer": given}
    name = _class(given)
    normalize = bool(getattr(given, "normalize_columns", False))
    if name == "STLSQ":
        for option, allowed in (("sparse_ind", None), ("ridge_kw", None), ("initial_guess", None), ("unbias", True)):
            _default(given, option, allowed)
        return {
            "optimizer": "stlsq",
            "threshold": float(given.threshold),
            "ridge": float(given.alpha),
            "normalize": normalize,
        }
    if name == "FROLS":
        _default(given, "kappa", None)
        return {"optimizer": "frols", "terms": int(given.max_iter)}
    mend = "name one: optimizer='stlsq', 'sr3', 'ssr', 'frols', 'lasso' or 'ols', with threshold= or terms="
    raise _refused(given, "is no optimiser that can be read", mend)
