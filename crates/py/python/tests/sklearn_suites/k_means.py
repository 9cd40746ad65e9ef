"""scikit-learn's tests of k-means."""

MODULE = "sklearn.cluster.tests.test_k_means"
PACKAGES = ["sklearn.cluster"]

EXPECTED: dict[str, str] = {}
