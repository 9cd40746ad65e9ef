"""scikit-learn's tests of coordinate descent."""

MODULE = "sklearn.linear_model.tests.test_coordinate_descent"
PACKAGES = ["sklearn.linear_model"]

_MULTI_TASK = (
    "compares coefficients to 7 digits with scikit-learn's multi-task class, which stops at tol=1e-4; with tol=1e-12 it "
    "agrees: test_coordinate_descent.py, test_one_task_is_the_multi_task_solution"
)

EXPECTED: dict[str, str] = {
    # Against solutions that are less exact.
    "test_1d_multioutput_enet_and_multitask_enet_cv": _MULTI_TASK,
    "test_1d_multioutput_lasso_and_multitask_lasso_cv": _MULTI_TASK,
    "test_lasso_dual_gap": (
        "compares the gap to 7 digits with that of one dual point; at an exact solution both are rounding, 2e-15"
    ),
    "test_warm_start": (
        "compares what 5 and 5 sweeps reach with what 10 sweeps reach, which is the same for plain sweeps alone; here "
        "sweeps work on the columns that count, and Newton steps come between them. Where the sweeps do not suffice, a "
        "ConvergenceWarning says so"
    ),
    # Other behaviour, on purpose.
    "test_lasso_alpha_warning": "expects a warning that alpha=0 does not converge well: here it does, to least squares",
    "test_check_input_false": (
        "expects an error for X in C order with check_input=False: here any order is read as it lies"
    ),
    "test_enet_copy_X_False_check_input_False": "expects X to be overwritten with copy_X=False: X is never written",
    "test_lassoCV_does_not_set_precompute*": (
        "puts a class in the place of a private name of scikit-learn; here the last fit is not made by another estimator"
    ),
}
