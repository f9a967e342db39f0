# Needs make and Python 3.11 or newer with venv; everything else goes into .venv.

PYTHON ?= python3
PYTEST_FLAGS ?= -n 2
LOCK_FLAGS ?=

BIN := .venv/bin
LOCKED := .venv/.locked
INSTALLED := .venv/.installed

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install reproduce test lint types format lock clean distclean

help: ## Show this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 12

install: $(INSTALLED) ## Make .venv with everything in requirements.lock

reproduce: install ## Run the main job: logs/run.rrd and its report
	@$(BIN)/python scenarios/pickplace.py

test: install ## Run the tests (PYTEST_FLAGS="-n 2")
	$(BIN)/python -m pytest $(PYTEST_FLAGS)

lint: install ## Check style and formatting
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: install ## Check types
	$(BIN)/mypy

format: install ## Format and apply safe fixes
	$(BIN)/ruff check --fix --exit-zero --quiet
	$(BIN)/ruff format

# A changed lock starts from an empty environment: upgrading MuJoCo in place can lose its files.
$(LOCKED): requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "robo47_qp needs Python 3.11 or newer, but $(PYTHON) is $$($(PYTHON) -V 2>&1)." \
	    "Name another one: make install PYTHON=python3.12" >&2; exit 1; }
	@echo "Installing the locked packages into .venv (about a minute)"
	@rm -rf .venv
	@$(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile \
	  --require-hashes -r requirements.lock
	@$(BIN)/python -m compileall -q -j 0 -x '/tests?/|_test\.py' .venv/lib
	@touch $@

$(INSTALLED): $(LOCKED) pyproject.toml
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --no-deps --no-build-isolation --editable .
	@touch $@

lock: ## Renew requirements.lock (LOCK_FLAGS=--upgrade for newer versions)
	@rm -rf build/lock && $(PYTHON) -m venv build/lock
	@build/lock/bin/python -m pip install --quiet --disable-pip-version-check uv
	@build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 \
	  --extra video --extra visuals --extra dev --fork-strategy fewest --generate-hashes --no-header \
	  $(LOCK_FLAGS) --output-file requirements.lock pyproject.toml

clean: ## Remove caches, builds and logs
	@rm -rf build dist *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	@find . -path ./.venv -prune -o -path ./.git -prune -o -name __pycache__ -type d \
	  -prune -exec rm -rf {} +
	@find logs -mindepth 1 ! -name README.md -delete

distclean: clean ## Also remove .venv
	@rm -rf .venv
