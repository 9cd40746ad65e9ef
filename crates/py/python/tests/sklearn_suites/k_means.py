"""scikit-learn's tests of k-means."""

MODULE = "sklearn.cluster.tests.test_k_means"
PACKAGES = ["sklearn.cluster"]

_PRIVATE = "does not apply: calls a private method of scikit-learn's class; tests/test_kmeans.py tests the same of ours"

EXPECTED: dict[str, str] = {
    "test_sample_weight_init[[]*]": _PRIVATE,
    "test_sample_weight_zero[[]*]": _PRIVATE,
}
