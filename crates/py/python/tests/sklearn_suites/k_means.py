"""scikit-learn's tests of k-means."""

MODULE = "sklearn.cluster.tests.test_k_means"
PACKAGES = ["sklearn.cluster"]

_SPARSE = "does not apply: sparse matrices are not supported, and refused by name"
_PRIVATE = "does not apply: calls a private method of scikit-learn's class; tests/test_kmeans.py tests the same of ours"

EXPECTED: dict[str, str] = {
    # MiniBatchKMeans and private functions stay scikit-learn's own, and so do their sparse cases.
    "test_kmeans_results[[]*sparse_*]": _SPARSE,
    "test_kmeans_relocated_clusters[[]*sparse_*]": _SPARSE,
    "test_kmeans_elkan_results[[]*sparse_*]": _SPARSE,
    "test_all_init[[]KMeans-*sparse_*]": _SPARSE,
    "test_kmeans_predict[[]*-KMeans-*sparse_*]": _SPARSE,
    "test_dense_sparse[[]*-KMeans-*]": _SPARSE,
    "test_predict_dense_sparse[[]KMeans-*]": _SPARSE,
    "test_integer_input[[]*-KMeans-*sparse_*]": _SPARSE,
    "test_float_precision[[]*-KMeans-sparse_*]": _SPARSE,
    "test_kmeans_init_fitted_centers[[]sparse_*]": _SPARSE,
    "test_unit_weights_vs_no_weights[[]*-KMeans-sparse_*]": _SPARSE,
    "test_scaled_weights[[]*-KMeans-sparse_*]": _SPARSE,
    "test_kmeans_empty_cluster_relocated[[]sparse_*]": _SPARSE,
    "test_k_means_1_iteration[[]*sparse_*]": _SPARSE,
    "test_predict_does_not_change_cluster_centers[[]csr_*]": _SPARSE,
    "test_relocating_with_duplicates[[]*sparse_*]": _SPARSE,
    "test_sample_weight_init[[]*]": _PRIVATE,
    "test_sample_weight_zero[[]*]": _PRIVATE,
}
