# Needs make and Python 3.11 or newer with venv; everything else goes into .venv.

PYTHON ?= python3
PYTEST_FLAGS ?= -n 2 --dist loadfile --no-loadscope-reorder
PYTHONS ?= $(PYTHON)
LOCK_FLAGS ?=
FRESH ?=
EPISODES ?= 100
MOTIONS ?= 200
# Part of its pace at which the clock of franka-sim goes: 1 where the machine keeps to a millisecond.
CLOCK ?= 0.25
# Named indirectly: `make -n` runs every line of a recipe that names MAKE itself.
AGAIN = $(MAKE) --no-print-directory

BIN := .venv/bin
C_FILES = $(wildcard robo47_qp/_core/*.[ch])
LOCKED := .venv/.locked
INSTALLED := .venv/.installed
JUDGES = $(patsubst scenarios/judges/%.lock,.judges/%/.installed,$(wildcard scenarios/judges/*.lock))

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install core wheel reproduce keep fresh-clone test judges judge lint types docs tables format lock \
  clean distclean

help: ## Show this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 14

install: $(INSTALLED) ## Make .venv with everything in requirements.lock

core: $(LOCKED) ## Build the compiled core of changed C sources
	@$(BIN)/python robo47_qp/_core/build.py

reproduce: install ## Run the main job (logs/run.rrd and its report), then the settling times
	@$(BIN)/python scenarios/pickplace.py
	@$(BIN)/python scenarios/settling.py
	@$(BIN)/python scenarios/cartpole_lqr.py

keep: reproduce ## Keep the figures of a run here: docs/reproduced.json, and where pages show them
	@$(BIN)/python scenarios/retro.py --keep
	@$(BIN)/python -m scenarios.tables

# What runs keep in the user's cache must not help a fresh clone; downloaded packages may.
fresh-clone: ## Clone, set up, run, compare with the kept figures: RETRO.md (FRESH=folder)
	@rm -f RETRO.md
	@git rev-parse --git-dir > /dev/null
	@test -z "$$(git status --porcelain)" || \
	  echo "Not committed, so not in the clone: $$(git status --porcelain | cut -c4- | xargs)"
	@set -e; folder="$(abspath $(FRESH))"; temporary=; \
	  if [ -z "$$folder" ]; then temporary=$$(mktemp -d); folder="$$temporary/clone"; fi; \
	  trap 'exit 130' INT TERM; trap 'test -z "$$temporary" || rm -rf "$$temporary"' EXIT; \
	  echo "Cloning $$(git rev-parse --short HEAD) into $$folder"; \
	  git clone --quiet "$(CURDIR)" "$$folder"; \
	  $(AGAIN) -C "$$folder" install; \
	  XDG_CACHE_HOME="$$folder/build/cache" $(AGAIN) -C "$$folder" reproduce; \
	  "$$folder/$(BIN)/python" "$$folder/scenarios/retro.py" --out "$(CURDIR)/RETRO.md" \
	    --commit "fresh clone of commit $$(git rev-parse --short HEAD)"

# Bytecode is kept, whatever the environment says: each worker would compile all anew.
test: export PYTHONDONTWRITEBYTECODE =
test: install ## Run the tests (PYTEST_FLAGS="-n 2 --dist loadfile --no-loadscope-reorder")
	$(BIN)/python -m pytest $(PYTEST_FLAGS)

judges: $(JUDGES) ## Make .judges, the environments of outside judges (see scenarios/judges)

judge: install judges ## Let outside judges judge: hours (EPISODES=100, MOTIONS=200)
	@$(BIN)/python scenarios/judge_franka.py --motions $(MOTIONS) --seed 2000000 --clock $(CLOCK) || test $$? = 1
	@$(BIN)/python scenarios/judge_robosuite.py --episodes $(EPISODES) --seed 2000000 --workers 2

wheel: install ## Try the wheel in new environments (PYTHONS="python3.12 python3.13")
	$(BIN)/python -m tests.wheel $(PYTHONS)

lint: install ## Check style and formatting
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/clang-format --dry-run --Werror $(C_FILES)

types: install ## Check types
	$(BIN)/mypy

# SPHINX_FLAGS=-a builds all pages anew.
docs: install ## Build the documentation (build/site/index.html); warnings are errors
	@$(BIN)/python -m sphinx -b html -q -W --keep-going -j auto $(SPHINX_FLAGS) docs build/site
	@echo "open build/site/index.html"

tables: install ## Write tables and figures of README and docs anew, from docs/results/*.json
	@$(BIN)/python -m scenarios.tables

format: install ## Format and apply safe fixes
	$(BIN)/ruff check --fix --exit-zero --quiet
	$(BIN)/ruff format
	$(BIN)/clang-format -i $(C_FILES)

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

$(INSTALLED): $(LOCKED) pyproject.toml setup.py
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --no-deps --no-build-isolation --editable .
	@touch $@

lock: ## Renew requirements.lock (LOCK_FLAGS=--upgrade for newer versions)
	@rm -rf build/lock && $(PYTHON) -m venv build/lock
	@build/lock/bin/python -m pip install --quiet --disable-pip-version-check uv
	@build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 \
	  --extra video --extra visuals --extra gym --extra franka \
	  --extra dev --extra docs --fork-strategy fewest --generate-hashes --no-header \
	  $(LOCK_FLAGS) --output-file requirements.lock pyproject.toml
	@for judge in scenarios/judges/*.in; do \
	  build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 \
	    --override $${judge%.in}.overrides --no-build --fork-strategy fewest \
	    --generate-hashes --no-header $(LOCK_FLAGS) --output-file $${judge%.in}.lock $$judge || exit; \
	done

# Judges pin versions that the product cannot share; nothing of theirs is compiled.
.judges/%/.installed: scenarios/judges/%.lock
	@echo "Installing the judge $* into .judges/$* (about a minute)"
	@rm -rf $(@D)
	@$(PYTHON) -m venv $(@D)
	@$(@D)/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
	  --only-binary :all: --no-deps --require-hashes -r $<
	@touch $@

clean: ## Remove caches, builds and logs
	@rm -f RETRO.md
	@rm -rf build dist robo47_qp/_core/built *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	@find . -path ./.venv -prune -o -path ./.judges -prune -o -path ./.git -prune -o -name __pycache__ -type d \
	  -prune -exec rm -rf {} +
	@find logs -mindepth 1 ! -name README.md -delete

distclean: clean ## Also remove .venv and .judges
	@rm -rf .venv .judges
