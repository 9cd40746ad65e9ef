"""scikit-learn's tests of least angle regression. Every number named here is asserted by `test_lars.py`."""

MODULE = "sklearn.linear_model.tests.test_least_angle"
PACKAGES = ["sklearn.linear_model"]

_COPY = "copy_X=False allows that X is overwritten, and the test wants it to be: fleetfoot never writes into X"
_JITTER = (
    "wants the fit without jitter to be wrong: two columns tie at the first knot, where scikit-learn's answer breaks "
    "the optimality conditions by 1.2 (alpha is 0.001), and fleetfoot's meets them to rounding; with jitter the fit is "
    "as wanted"
)

EXPECTED: dict[str, str] = {
    "test_lasso_lars_copyX_behaviour[[]False[]]": _COPY,
    "test_lasso_lars_fit_copyX_behaviour[[]False[]]": _COPY,
    "test_lars_with_jitter[[]est[01][]]": _JITTER,
}
