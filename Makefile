# One-line doors to the tools; nothing here is needed once the environment is active.
SHELL := /bin/bash
PYTHON ?= python3
BIN := .venv/bin
UV := $(BIN)/python -m uv
SNAKEMAKE := $(BIN)/python -m snakemake
UV_VERSION := 0.13.9
READY := .venv/.ready
# Packages are compiled to bytecode at once: every job is a Python of its own and would do it again.
# One thread a job: two jobs run side by side. Caches stay here, so that any user may build anywhere.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export XDG_CACHE_HOME ?= $(CURDIR)/.cache
export MPLCONFIGDIR ?= $(CURDIR)/.cache/matplotlib
export PYTHONHASHSEED := 0
# Jobs start sooner when the bytecode of this project is kept, too.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: all quick test report lint format lock bench accept setup clean
.DEFAULT_GOAL := all

all: $(READY)  ## every study with its default worlds
	$(SNAKEMAKE)

quick: $(READY)  ## the same pages from few worlds
	$(SNAKEMAKE) --configfile config/quick.yaml

test: $(READY)  ## the test suite
	$(BIN)/python -m pytest -n 2 --dist loadgroup

report: all  ## Snakemake's own provenance report
	$(SNAKEMAKE) --report reports/provenance.html

lint: $(READY)  ## style, types and workflow
	$(BIN)/python -m ruff check .
	$(BIN)/python -m ruff format --check .
	$(BIN)/python -m snakefmt --check Snakefile workflow
	$(BIN)/python -m mypy
	$(SNAKEMAKE) --lint

format: $(READY)
	$(BIN)/python -m ruff check --fix .
	$(BIN)/python -m ruff format .
	$(BIN)/python -m snakefmt Snakefile workflow

lock: $(READY)  ## resolve the dependencies anew
	$(UV) pip compile pyproject.toml --group dev --universal --python-version 3.11 --no-emit-index-url \
	  --generate-hashes --no-annotate --no-header --upgrade -o requirements.lock

bench: $(READY)  ## speed and memory, measured and printed
	$(BIN)/python -m pytest benchmarks -o python_files='bench_*.py' -o addopts= --benchmark-only

accept: $(READY)  ## take the verdicts of a full build over as the accepted ones, and into the README
	$(SNAKEMAKE) reports/index.html
	mkdir -p tests/golden
	cp results/claims.csv tests/golden/claims.csv
	$(BIN)/python docs/readme_tables.py

setup: $(READY)

$(READY): requirements.lock pyproject.toml Makefile
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m uv --version 2>/dev/null | grep -qF $(UV_VERSION) || $(BIN)/python -m pip install -q uv==$(UV_VERSION)
	$(UV) pip sync -q --compile-bytecode --require-hashes requirements.lock
	$(UV) pip install -q --no-deps --no-build-isolation -e .
	touch $(READY)

clean:  ## remove everything that was computed
	rm -rf results data/synthetic data/recorded data/quick reports/quick .snakemake
	find reports -type f ! -name README.md -delete
