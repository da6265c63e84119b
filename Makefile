# `make run` and `make test` set up everything they need: Python 3.11 to 3.13 and make are enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PEERS := .venv-peers
DEMO := outputs/remus100
PAGES := tests/cli tests/dashboard tests/campaign tests/core tests/docs tests/report
CAMPAIGNS := $(PAGES) tests/logs tests/benchmark

.PHONY: run test test-campaigns test-library quick proof proof-campaigns proof-library pythons lint types imports examples bench figures notebooks docs dist lock clean

run: $(VENV)/ready
	@test -f $(DEMO)/campaign.toml || $(BIN)/seatrial init $(DEMO)
	@$(BIN)/seatrial run $(DEMO)

# Both halves at once: each keeps about one core busy. A test runs its programs once: optimised and fused they take longer to compile than that saves.
# The last of the options is one of JAX 0.10, where plain loops compile in a third of the time; XLA refuses what it does not know.
test test-campaigns test-library: export XLA_FLAGS = --xla_backend_optimization_level=0 --xla_cpu_parallel_codegen_split_count=1 \
	$(shell $(BIN)/python -c 'import jaxlib; print("--xla_cpu_use_fusion_emitters=false" * jaxlib.__version__.startswith("0.10."))' 2>/dev/null)
test: $(VENV)/ready
	$(MAKE) --no-print-directory -j2 --output-sync=target test-campaigns test-library

test-campaigns: $(VENV)/ready
	$(BIN)/python -m pytest -m "not proof" --durations=25 $(CAMPAIGNS) studies

test-library: $(VENV)/ready
	$(BIN)/python -m pytest -m "not proof" --durations=25 tests $(CAMPAIGNS:%=--ignore=%)

# What takes less than ten seconds each.
quick: $(VENV)/ready
	$(BIN)/python -m pytest -m "not thorough and not proof"

# Long sweeps that rarely break: golden numbers, reference posteriors, calibrations, damaged logs, the study at full size, code of the docs.
proof: $(VENV)/ready
	$(MAKE) --no-print-directory -j2 --output-sync=target proof-campaigns proof-library

proof-campaigns: $(VENV)/ready
	$(BIN)/python -m pytest -m proof --durations=25 $(PAGES)

proof-library: $(VENV)/ready
	$(BIN)/python -m pytest -m proof --durations=25 tests studies $(PAGES:%=--ignore=%)

# The part of `make proof` that runs `make quick` on other Pythons with their JAX; it says which Python is missing.
pythons: $(VENV)/ready
	$(BIN)/python -m pytest -m proof -rs tests/test_package.py -k other_pythons

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python docs/style.py

types: $(VENV)/ready
	$(BIN)/basedpyright

imports: $(VENV)/ready
	$(BIN)/lint-imports

examples: $(VENV)/ready
	$(BIN)/python examples/run_all.py

# `make bench ONLY=against` measures against other packages alone, `ONLY="peers memory"` what these names choose.
bench: $(VENV)/ready $(PEERS)/ready
	$(BIN)/python benchmarks/run.py $(ONLY)

# What others use and our environment cannot hold, at exact versions.
$(PEERS)/ready: benchmarks/requirements.txt | $(VENV)/ready
	@echo "setting up $(PEERS): about two minutes"
	$(PYTHON) -m venv $(PEERS)
	$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check --requirement $<
	@touch $@

figures: $(VENV)/ready
	$(BIN)/python docs/figures.py

# Pages of docs/notebooks with what their code shows.
notebooks: $(VENV)/ready
	$(BIN)/python docs/notebooks.py

# HTML in docs/_build, from local files only; a warning is an error.
docs: $(VENV)/ready
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build
	@echo "docs/_build/index.html"

# Wheel and sdist in dist, and each extra tried in an environment of its own.
dist: $(VENV)/ready
	$(BIN)/python release/check.py

# Exact versions and the hashes of their files, without the address of any index.
lock: $(VENV)/ready
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --group dev --group docs --universal --python-version 3.11 --upgrade --generate-hashes \
		--no-header --no-annotate --no-emit-index-url --no-emit-find-links --output-file requirements.lock

$(VENV)/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if (3, 11) <= v < (3, 14) else f"seatrial needs Python 3.11 to 3.13; this is {v.major}.{v.minor}. Try: make PYTHON=python3.11 run")'
	@echo "setting up $(VENV): one to three minutes"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

clean:
	rm -rf $(VENV) $(PEERS) outputs .pytest_cache .ruff_cache build dist
