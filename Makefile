# Each target does its own set-up: Linux, Python 3.11 or newer and make are enough.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

PYTHON ?= python3
# $(PYTHON) if it is new enough, else a newer one on the path; empty if there is none
NEW_PYTHON := $(firstword $(foreach python,$(PYTHON) python3.11 python3.12 python3.13 python3.14 python3,$(shell \
    $(python) -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && echo $(python))))
PIP := -m pip --disable-pip-version-check --quiet
SOURCES := $(shell find whitted integrators scenes -type f -not -name '*.pyc' 2>/dev/null) README.md LICENSE

.PHONY: help demo test test-long fuzz benchmarks studies studies-paper viewer lint format clean

help: ## say what there is
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: .venv/ready ## render the shipped pictures and prove them against Mitsuba's path tracer
	.venv/bin/python experiments/demo.py

test: .venv-test/ready ## build the wheel, install it, and run the tests against it
	@# safe path: the source tree in the working folder must not shadow the wheel, in child processes either
	PYTHONSAFEPATH=1 WHITTED_TEST_WHEEL=1 .venv-test/bin/python -m pytest -n auto --dist loadfile -m "not long" $(PYTEST_FLAGS)

test-long: .venv-test/ready ## run the tests that take minutes, such as the rate of false alarms
	PYTHONSAFEPATH=1 WHITTED_TEST_WHEEL=1 .venv-test/bin/python -m pytest -m long $(PYTEST_FLAGS)

fuzz: .venv/ready ## render 2000 scenes mutated at random: a quarter of an hour; what fails stays in out/fuzz
	.venv/bin/python tests/fuzz.py --keep out/fuzz $(FUZZ_FLAGS)

benchmarks: .venv/ready ## measure all tables of docs/*.md and README.md: two hours of a quiet machine
	@for script in benchmarks/{distribution,ablations,rays,path,povray,robust,report_page,study_scale} replicate_cost; do \
	    echo "== $$script"; .venv/bin/python experiments/$$script.py; \
	done

STUDIES := soft_shadows gloss depth_of_field whitted_vs_path samplers

studies: .venv/ready ## render the shipped studies in their small size, with a report of each in out/studies
	$(call run_studies,small)

studies-paper: .venv/ready ## the same in the size for papers: half an hour for each, and it goes on where it was stopped
	$(call run_studies,paper)

viewer: ## build the scripts of reports, viewer and plots, from web/, which needs Node.js
	cd web && npm ci && npm run build

lint: .venv/ready ## check style and format
	.venv/bin/ruff check
	.venv/bin/ruff format --check

format: .venv/ready ## apply the format
	.venv/bin/ruff check --fix
	.venv/bin/ruff format

clean: ## remove what was built, environments included
	rm -rf .venv .venv-test build dist *.egg-info .pytest_cache .ruff_cache

.venv/ready: pyproject.toml
	$(call new_environment,.venv)
	.venv/bin/python $(PIP) install --editable '.[dev]'
	@touch $@

.venv-test/ready: pyproject.toml dist/ready
	$(call new_environment,.venv-test)
	.venv-test/bin/python $(PIP) install --force-reinstall --no-deps dist/*.whl
	.venv-test/bin/python $(PIP) install "$$(echo dist/*.whl)[test]"
	@touch $@

# The sdist first, and the wheel from it, so that what the sdist lacks is missed here.
dist/ready: .venv/ready pyproject.toml $(SOURCES)
	rm -rf dist build
	.venv/bin/python -m build --outdir dist . >build.log 2>&1 || { cat build.log >&2; exit 1; }
	rm build.log
	@touch $@

define new_environment
@test -n '$(NEW_PYTHON)' || { echo 'error: Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11' >&2; exit 1; }
@test -x $(1)/bin/python && $(1)/bin/python $(PIP) --version >/dev/null 2>&1 || $(NEW_PYTHON) -m venv --clear $(1) \
    || { echo 'error: $(NEW_PYTHON) cannot make a virtual environment: apt install python3-venv' >&2; exit 1; }
@echo '*' > $(1)/.gitignore
endef

define run_studies
@mkdir -p out/studies
@for study in $(STUDIES); do \
    .venv/bin/whitted study $$study --size $(1) -o out/studies/$$study-$(1) && \
    .venv/bin/whitted report out/studies/$$study-$(1) -o out/studies/$$study-$(1).html || exit 1; \
done
endef
