# Each target does all its own set-up: on a fresh machine `make demo` or `make test` alone is enough.
# Needs make, Python 3.11 or newer with venv, and a package index or wheels that pip knows of.

PYTHON ?= python3
VENV ?= .venv
ARGS ?=
WORKERS ?= auto
BENCH_RUNS ?= 20

bin := $(VENV)/bin
pytest := $(bin)/python -m pytest --numprocesses $(WORKERS) --maxprocesses 8 --dist loadfile
benches := $(basename $(notdir $(shell grep -l __main__ bench/*.py)) fleets registration joint_fusion)

.PHONY: demo test test-all bench lint format schemas clean help
.DEFAULT_GOAL := help

demo: $(VENV)/installed-view  ## run the default scenario end to end; recording and report go to recordings/
	$(bin)/crossfix run scenarios/strait.toml --verify --report $(ARGS)

test: $(VENV)/installed-test  ## all tests but the slow ones; ARGS="-k name" picks some, WORKERS=0 takes one core
	$(pytest) $(ARGS)

test-all: $(VENV)/installed-test  ## all tests, the long statistics too
	$(pytest) -m "" $(ARGS)

bench: $(VENV)/installed-view  ## every benchmark, briefly; BENCH_RUNS=2000 for figures worth quoting
	@for name in $(benches); do \
	    echo "== bench.$$name"; \
	    $(bin)/python -m bench.$$name --runs $(BENCH_RUNS) $(ARGS) || exit 1; \
	done

lint: $(VENV)/installed-test  ## every check of .ci/run except the tests
	.ci/run --no-tests

format: $(VENV)/installed-test  ## let ruff mend what it can
	$(bin)/ruff check --fix .
	$(bin)/ruff format .

schemas: $(VENV)/installed-test  ## write the exported JSON Schema files anew
	$(bin)/python -m schemas.json_schema

clean:  ## remove the environment and all caches; recordings stay
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1: /p' $(MAKEFILE_LIST) | awk -F': ' '{printf "  make %-10s %s\n", $$1, $$2}'

# A stamp is written only after its step succeeded, so an interrupted installation is done again.
$(VENV)/created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	    echo "crossfix needs Python 3.11 or newer, and '$(PYTHON)' is $$($(PYTHON) --version 2>&1 | head -n 1);" \
	         "name another one: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "'$(PYTHON)' cannot make virtual environments: install its venv module" \
	         "(Debian and Ubuntu: apt-get install python3-venv)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/installed-view: extras = view
$(VENV)/installed-test: extras = test,view
$(VENV)/installed-%: $(VENV)/created pyproject.toml
	@echo "installing crossfix[$(extras)] into $(VENV)"
	@$(bin)/python -m pip install --quiet --editable '.[$(extras)]'
	@touch $@
