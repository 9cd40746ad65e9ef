"""scikit-learn's tests of coordinate descent."""

MODULE = "sklearn.linear_model.tests.test_coordinate_descent"
PACKAGES = ["sklearn.linear_model"]

EXPECTED: dict[str, str] = {}
