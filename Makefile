# Two commands on a fresh machine with Python 3.11 or newer: `make demo`, `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   := demo

.PHONY: help demo test test-all lint gallery bench clean

help:
	@echo "make demo      install, and ask whether a UR5 can carry 5 kg along a bundled path"
	@echo "make test      install, then lint, types, import layers and all tests but the slow ones"
	@echo "make test-all  the same with the slow oracles"
	@echo "make gallery   run the numbered examples, and make docs/gallery.md of their pictures"
	@echo "make bench     time every kernel beside its peers, and write bench/RESULTS.md"
	@echo "make clean     remove what the above made"

$(VENV)/.made:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	touch $@

$(VENV)/.demo: pyproject.toml | $(VENV)/.made
	$(BIN)/python -m pip install --quiet -e ".[plot]"
	touch $@

$(VENV)/.dev: pyproject.toml | $(VENV)/.made
	$(BIN)/python -m pip install --quiet -e ".[dev]"
	touch $@ $(VENV)/.demo

# Exit status 1 means "ran, and a joint is over a limit", which is an answer too.
demo: $(VENV)/.demo
	mkdir -p $(DEMO)
	$(BIN)/twistwrench torques ur5 --trajectory demo --payload 5 \
	  --csv $(DEMO)/torques.csv --plot $(DEMO)/torques.png || [ $$? -eq 1 ]

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint
	$(BIN)/pytest -n 2

test-all: lint
	$(BIN)/pytest -n 2 -m "slow or not slow"

gallery: $(VENV)/.demo
	$(BIN)/python -m examples

bench: $(VENV)/.dev
	$(BIN)/python -m bench
	$(BIN)/python -m bench.book

clean:
	rm -rf $(VENV) $(DEMO) build dist .pytest_cache .mypy_cache .ruff_cache
