# One command for each thing that a developer does. `make test` is what CI runs, together with `make lint`.
.PHONY: test lint docs bench

test:
	cargo test --workspace --locked

lint:
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --locked -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked

docs:
	cargo doc --workspace --no-deps --open

# Timings beside the peers: pip install numpy scikit-learn pysindy faiss-cpu pyarrow mujoco adelie, and FLEETFOOT_PYTHON=that python.
bench:
	cargo bench -p fleetfoot-benches
