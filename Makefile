# make demo      the main job on a bundled light curve, and where its report is
# make test      the tests, without the long statistical runs
# make test-more what CI tests beside that
# make test-all  every test
# make docs      the site, with a gallery whose pages are made anew where they changed
# make site SITE=DIR  adds what make docs built to the versions in DIR (NAME=dev: not under its number)
# make calibration  how far every model and sampler can be relied on, into docs/calibration.md; hours
# make lint      formatting, lint and types, as CI checks them (make format repairs)
# make clean     removes the environment and whatever else was made here
#
# The environment is .venv; PYTHON=... chooses the interpreter for it (3.12 or newer).

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

PYTHON ?=
VENV := .venv
BIN := $(VENV)/bin
WORKERS ?= 2

DEMO_CURVE ?= lcbayes/simulation/scenarios/box-wing.csv
DEMO_ARGS ?= --tle lcbayes/simulation/scenarios/box-wing.tle --n-facets 6 --seed 1
DEMO_DIR ?= demo

# Without PYTHON= the first of these that starts and is new enough. Each is run, because a version
# manager's shim can be there without a version behind it.
CANDIDATES := python3.12 python3.13 python3.14 python3 python \
	$(wildcard $(or $(PYENV_ROOT),$(HOME)/.pyenv)/versions/3.*/bin/python3)
NEW_ENOUGH := import sys; sys.exit(sys.version_info < (3, 12))
BASE := import sys; print(sys.base_prefix)

# An environment made from another interpreter than the one now asked for is made anew.
ifneq ($(PYTHON),)
  $(shell [ ! -e $(BIN)/python ] || ! "$(PYTHON)" -c '$(BASE)' >/dev/null 2>&1 || \
    [ "$$("$(PYTHON)" -c '$(BASE)')" = "$$($(BIN)/python -c '$(BASE)')" ] || rm -rf $(VENV))
endif

.PHONY: help demo env test test-more test-all docs site calibration lint format clean

help:
	@sed -n '1,11s/^# \{0,1\}//p' Makefile

$(BIN)/python:
	@for candidate in $(if $(PYTHON),"$(PYTHON)",$(CANDIDATES)); do \
	  if "$$candidate" -c '$(NEW_ENOUGH)' >/dev/null 2>&1; then \
	    exec "$$candidate" -m venv --clear $(VENV); \
	  fi; \
	done; \
	if [ -z "$(PYTHON)" ] && command -v uv >/dev/null 2>&1; then \
	  exec uv venv --quiet --seed --clear --python '>=3.12' $(VENV); \
	fi; \
	echo "$(if $(PYTHON),PYTHON=$(PYTHON) is not Python 3.12 or newer,no Python 3.12 or newer was found);" \
	  "install one, then give its path: make PYTHON=/path/to/python3.12" >&2; \
	exit 1

# Two stamps, because the demo does without the developers' tools.
$(VENV)/.installed: pyproject.toml $(BIN)/python
	@echo "installing lcbayes into $(VENV), about a minute"
	@$(BIN)/python -m pip install -qq --disable-pip-version-check -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml $(BIN)/python
	@echo "installing lcbayes and the developers' tools into $(VENV), about a minute"
	@$(BIN)/python -m pip install -qq --disable-pip-version-check -e '.[dev]'
	@touch $(VENV)/.installed $@

$(VENV)/.installed-docs: pyproject.toml $(BIN)/python
	@echo "installing lcbayes and what makes its site into $(VENV), about a minute"
	@$(BIN)/python -m pip install -qq --disable-pip-version-check -e '.[docs]'
	@touch $(VENV)/.installed $@

env: $(VENV)/.installed-dev

demo: $(VENV)/.installed
	@status=0; $(BIN)/lcbayes fit $(DEMO_CURVE) $(DEMO_ARGS) -o $(DEMO_DIR) || status=$$?; \
	if [ $$status = 0 ] || [ $$status = 3 ]; then \
	  echo "report: $(CURDIR)/$(DEMO_DIR)/report.html"; \
	fi; \
	exit $$status

# The workers share the cores: a BLAS that takes all of them for each call of each worker is slower.
test test-more test-all: export OPENBLAS_NUM_THREADS = 1

# Most of the time of the quick run is compilation, so XLA optimises the programs less, and compiles
# each as one piece instead of 32. `make test-all` tests the programs that a user runs.
test test-more: export JAX_DISABLE_MOST_OPTIMIZATIONS = 1
test test-more: export XLA_FLAGS := $(XLA_FLAGS) --xla_cpu_parallel_codegen_split_count=1

# A file's tests stay with one worker, which makes its fixtures once; in the order of the folders,
# that of the longest files first, so that both workers end together.
SHARED := -n $(WORKERS) --dist loadfile --no-loadscope-reorder

test: env
	@$(BIN)/python -m pytest -m "not slow and not medium" $(SHARED)

test-more: env
	@$(BIN)/python -m pytest -m "medium and not slow" $(SHARED)

test-all: env
	@$(BIN)/python -m pytest $(SHARED)

docs: $(VENV)/.installed-docs
	@$(BIN)/python docs/make_gallery.py --workers $(WORKERS)
	@$(BIN)/python -m sphinx -b html -q -W --keep-going -d docs/_build/doctrees docs docs/_build/html
	@echo "site: $(CURDIR)/docs/_build/html/index.html"

# From the command line alone: some systems set NAME for other purposes.
SITE :=
NAME :=

site: $(BIN)/python
	@$(BIN)/python docs/make_site.py $(if $(SITE),"$(SITE)") $(NAME)

calibration: env
	@$(BIN)/python docs/make_calibration.py

lint: env
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/pyright

format: env
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

clean:
	@rm -rf $(VENV) build dist *.egg-info demo docs/_build docs/api .pytest_cache .ruff_cache .coverage
	@find docs/gallery -mindepth 1 ! -name '*.toml' ! -name '*.obj' -delete
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
