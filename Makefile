# `make demo` and `make test` need only make and Python >= 3.11; everything else they install into .venv:
# `make demo` what a user needs, the others also the extra dev.

BIN := .venv/bin
READY := .venv/.ready
DEV := .venv/.ready-dev
CANDIDATES := python3.13 python3.12 python3.11 python3
USABLE := import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))

# the processes that tests start load stored byte code
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo docs notebooks test pythons clean

demo: $(READY)
	$(BIN)/python -m pulsepath plan circle --machine hexapod --out out/demo --force

# the pages as a site: out/docs/index.html; the notebooks are run for it
docs: notebooks
	$(BIN)/python -m sphinx -W --keep-going -q docs out/docs

# executed, with their figures; the sources are notebooks/*.py
notebooks: $(DEV)
	$(BIN)/python -m tests.notebooks.run out/notebooks

# fast checks first; the first that fails ends the run
test: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy
	$(BIN)/mypy --no-strict-optional --follow-imports=silent notebooks/*.py
	$(BIN)/pytest -n 2

# all tests on the other Pythons from 3.11 to 3.13 that are here
pythons: $(DEV)
	.ci/pythons

$(READY): pyproject.toml
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || { \
	  for python in $(CANDIDATES); do \
	    if $$python -c '$(USABLE)' >/dev/null 2>&1; then echo "$$python -m venv .venv"; exec $$python -m venv --clear .venv; fi; \
	  done; \
	  echo "pulsepath needs Python >= 3.11 with its venv module (on Debian: apt install python3-venv); tried: $(CANDIDATES)" >&2; \
	  exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(DEV): $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

clean:
	rm -rf out build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find $(wildcard kinematics planner controllers benchmarks pulsepath tests) -name __pycache__ -prune -exec rm -rf {} +
