"""scikit-learn's tests of least angle regression."""

MODULE = "sklearn.linear_model.tests.test_least_angle"
PACKAGES = ["sklearn.linear_model"]

EXPECTED: dict[str, str] = {}
