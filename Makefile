# make demo        sets up .venv and runs the main command on a sample campaign
# make test        sets up .venv and runs the tests, in about six minutes
# make browser     the tests of pages, in a browser
# make docs        builds the docs into out/docs, every warning an error; tests them
# make readme      the commands of README.md, in a fresh environment with the wheel
# make nightly     the tests that take longest: campaigns, effects, the article
# make quick       the quick tests of what has changed, in under a minute
# make lint        ruff and mypy
# make tables      measures what is out of date in tables of README and docs; hours
# make proofs      proves of the shipped funnels that no flight leaves; a quarter of an hour
# make benchmark   timings
# make clean       removes caches, builds and out/demo
# make distclean   ... and every environment that make or .ci/run has set up
#
# make test PYTHON=python3.12 VENV=.venv-3.12 uses another interpreter.

VENV ?= .venv
BIN := $(VENV)/bin
# What marks an environment that runs the program, and one that runs its tests too.
RUNS := $(VENV)/.runs
READY := $(VENV)/.ready

# Arguments for pytest; `make test PYTEST_ARGS="tests/test_paths.py -x"`.
PYTEST_ARGS ?=

# An interpreter is good if it runs (a pyenv shim may exist and not), is new
# enough and can make environments (Debian's cannot without python3-venv).
IS_GOOD := 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))'
ifndef PYTHON
PYTHON := $(shell for p in python3.12 python3.11 python3 python; do \
	if $$p -c $(IS_GOOD) >/dev/null 2>&1; then echo $$p; break; fi; done)
else ifneq ($(shell $(PYTHON) -V 2>&1),$(shell $(BIN)/python -V 2>&1))
# An interpreter was asked for, and the environment is of another version.
$(RUNS) $(READY): FORCE
endif

.PHONY: demo test browser docs readme nightly quick lint tables proofs benchmark setup clean \
	distclean FORCE

demo: $(or $(wildcard $(READY)),$(RUNS))
	$(BIN)/glider close-the-loop attached_lift --out out/demo

PYTEST := $(BIN)/python -m pytest
PARALLEL := -n auto --maxprocesses 4 --dist worksteal
# The files with tests of a marker, unless others are asked for: importing all tests
# takes longer than running a few.
marked = $(if $(filter tests%,$(PYTEST_ARGS)),,$$(grep -rlw --include='test_*.py' \
	'mark\.$(1)' tests))

# The machine code that many tests share is compiled once, before there are workers.
test: setup
	$(BIN)/python -m tests.warm_up
	$(PYTEST) -m 'not (nightly or browser or docs or readme)' $(PARALLEL) $(PYTEST_ARGS)

browser: setup
	$(PYTEST) -m 'browser and not nightly' $(call marked,browser) $(PYTEST_ARGS)

docs: setup
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs out/docs
	SITE=out/docs $(PYTEST) -m docs $(call marked,docs) $(PYTEST_ARGS)
	@echo "The docs are in out/docs/index.html."

readme: setup
	$(PYTEST) -m readme $(call marked,readme) $(PYTEST_ARGS)

nightly: setup
	$(PYTEST) -m nightly $(PARALLEL) $(PYTEST_ARGS)

quick: setup
	$(PYTEST) -q $(PARALLEL) $$($(BIN)/python tests/changed.py) $(PYTEST_ARGS)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

tables: setup
	$(BIN)/python -m benchmarks.tables

proofs: setup
	for funnel in drawn head_wind head_wind_95; do \
		$(BIN)/glider check-funnel models/funnels/$$funnel.npz --prove || exit 1; \
	done
	for funnel in models/funnels/*_hook.npz; do \
		$(BIN)/glider check-funnel $$funnel --hook --prove || exit 1; done

benchmark: setup
	@for script in benchmarks/bench_*.py; do \
		echo "$$script"; \
		$(BIN)/python -m "benchmarks.$$(basename "$$script" .py)" || exit 1; \
	done

setup: $(READY)

$(READY): EXTRAS := [test]
$(RUNS) $(READY): pyproject.toml
	@test -n "$(PYTHON)" && $(PYTHON) -c $(IS_GOOD) >/dev/null 2>&1 || { \
		echo "Expected Python 3.11 or later with its venv module," \
			"$(if $(PYTHON),but $(PYTHON) will not do,found none)" \
			"here: install it (on Debian and Ubuntu python3-venv too)" \
			"or name one with make PYTHON=/path/to/python." >&2; exit 1; }
	@echo "Setting up $(VENV): Drake and the other requirements of pyproject.toml are" \
		"downloaded and installed (a minute or more the first time, and silent) ..."
	@test "$$($(BIN)/python -V 2>&1)" = "$$($(PYTHON) -V 2>&1)" \
		&& $(BIN)/python -m pip --version >/dev/null 2>&1 \
		|| $(PYTHON) -m venv --clear $(VENV)
	@{ command -v uv >/dev/null \
		&& uv pip install -q --python $(BIN)/python --editable '.$(EXTRAS)'; } \
		|| $(BIN)/python -m pip install -qq --disable-pip-version-check --no-input \
			--no-compile --editable '.$(EXTRAS)' || { \
		echo "Setting up $(VENV) failed: pip's message is above;" \
			"once that is fixed, make goes on from here." >&2; exit 1; }
	@touch $@

FORCE:

clean:
	rm -rf out/demo build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -path './.venv*' -prune -o -name __pycache__ -prune -exec rm -rf {} +

distclean: clean
	rm -rf .venv .venv-*
