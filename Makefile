# `make` alone only prints this help. Everything is installed into .venv, at the versions of constraints.txt.
.DEFAULT_GOAL := help
.PHONY: help install run test test-all lint docs dist demo-template clean
.DELETE_ON_ERROR:

VENV := .venv
BIN := $(VENV)/bin
INPUTS := pyproject.toml constraints.txt
PIP_INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable
PYTEST = $(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder
NEEDS := import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-13s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

install: $(VENV)/.installed  ## make .venv and install the package, once

run: install  ## train: point to point, 10 seeds; more options in ARGS="..."
	$(BIN)/python -m srl_jax.run --seeds 10 --task p2p $(ARGS)

test: $(VENV)/.installed-dev  ## run the tests; pytest options in ARGS="..."
	$(PYTEST) $(ARGS)

test-all: $(VENV)/.installed-dev  ## run the tests and the slow ones, which take ten minutes more
	$(PYTEST) -m "slow or not slow" $(ARGS)

lint: $(VENV)/.installed-dev  ## check style, format and types; changes nothing
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright

docs: $(VENV)/.installed-dev  ## build the documentation's site into build/site; a link that leads nowhere fails
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

dist: $(VENV)/.installed-dev  ## build sdist and wheel, and try the wheel in an empty environment outside the checkout
	rm -rf dist
	$(BIN)/python -m build --no-isolation --outdir dist . >/dev/null
	PYTHON=$(BIN)/python tests/wheel.sh dist/*.whl

demo-template:  ## build the page that the demo fills anew, from web/ (needs Node.js and npm)
	cd web && npm install --no-audit --no-fund --no-package-lock && npm run build

clean:  ## remove .venv, caches and build output; results in runs/ stay
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -not -path './runs/*' -prune -exec rm -rf {} +

$(VENV)/.installed: $(INPUTS) | $(BIN)/python
	@echo 'Installing into $(VENV): about a minute.'
	@$(PIP_INSTALL) .
	@touch $@

# The dev set contains the plain one, so it brings both stamps up to date.
$(VENV)/.installed-dev: $(INPUTS) | $(BIN)/python
	@echo 'Installing into $(VENV), with the test tools: about a minute and a half.'
	@$(PIP_INSTALL) '.[dev,dist,docs,web]'
	@touch $(VENV)/.installed $@

$(BIN)/python:
	@for python in python3.11 python3; do \
		if $$python -c '$(NEEDS)' 2>/dev/null; then exec $$python -m venv --clear $(VENV); fi; \
	done; \
	echo 'srl_jax needs Python 3.11 or newer with its venv module, as python3.11 or python3 on the PATH.' >&2; exit 1
