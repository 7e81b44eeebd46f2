# `make run` runs the paper's square, `make test` the tests; both build .venv first.
.DEFAULT_GOAL := help
.PHONY: help env run test test-all pythons lint types paper studies bench validate soak lock upgrade clean docs

# Another Python beside the first: make test VENV=.venvs/3.10 PYTHON=python3.10
VENV ?= .venv
export VENV
# Where it is set, every process compiles the sources again, and pytest all tests.
unexport PYTHONDONTWRITEBYTECODE
BIN := $(VENV)/bin
PYTEST_ARGS ?=
# Tests that run at once, of those that start no nodes.
TEST_JOBS ?= 2
# Of those that start nodes, which wait half of their time; 0: in pytest's own process, one by one.
NODE_JOBS ?= 3
SOAK_MINUTES ?= 30

help:
	@echo 'make run       the paper'\''s square with fls_tip: nodes, bag, metrics, pictures'
	@echo 'make test      format, lint, types and tests'
	@echo 'make test-all  the same with the slow tests'
	@echo 'make pythons   a run on every Python and every ROS 2 distribution that there are wheels for'
	@echo 'make paper     the paper'\''s ten cases, its claims one by one, its Figures 5 to 8'
	@echo 'make studies   the tables and pictures of docs/paper.md, stability.md and fls.md, an hour'
	@echo 'make bench     speed of the loop and of the nodes'
	@echo 'make validate  the models against theory and reference solutions'
	@echo 'make soak      runs back to back for SOAK_MINUTES (30), watched for growth'
	@echo 'make docs      the documentation as a site, docs/_build/index.html'
	@echo 'make env       .venv only (the others call it)'
	@echo 'make lock      constraints/ for the requirements in setup.py; make upgrade: with new versions'

env:
	@scripts/env.sh

run: env
	@$(BIN)/flexarm run config/fls_tip.yaml

lint: env
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: env
	$(BIN)/mypy

test: lint types
	@TEST_JOBS=$(TEST_JOBS) NODE_JOBS=$(NODE_JOBS) scripts/test.sh $(PYTEST_ARGS)

test-all: lint types
	$(BIN)/python -m pytest -m 'slow or not slow' $(PYTEST_ARGS)

paper: env
	@$(BIN)/flexarm suite config/paper.yaml

studies: env
	@$(BIN)/python -m validation.paper_claims
	@$(BIN)/python -m validation.stability_map

bench: env
	@$(BIN)/python -m bench

validate: env
	@$(BIN)/python -m validation
	@$(BIN)/python -m validation.golden
	@$(BIN)/python -m validation.versions

soak: env
	@$(BIN)/python scripts/soak.py --minutes $(SOAK_MINUTES)

docs: env
	$(BIN)/python -m sphinx -W --keep-going -q -j 2 docs docs/_build
	@echo docs/_build/index.html

pythons: env
	@scripts/pythons.sh

lock: env
	@scripts/lock.sh

upgrade: env
	@scripts/lock.sh --upgrade

clean:
	rm -rf .venv .venvs build dist install log .pytest_cache .mypy_cache .ruff_cache .hypothesis *.egg-info
	find flexarm_ros test -name __pycache__ -type d -prune -exec rm -rf {} +
