# Two commands on a fresh machine with Python 3.11 or newer: `make demo`, `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   := demo

.PHONY: help demo test test-all lowest lint gallery bench clean

help:
	@echo "make demo      install, and ask whether a UR5 can carry 5 kg along a bundled path"
	@echo "make test      install, then lint, types, import layers and all tests but the slow ones"
	@echo "make test-all  the same with the slow oracles"
	@echo "make lowest    install the oldest versions that pyproject.toml allows, and run the tests but the slow ones on them"
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

# Run-time extras and what tests need; linters and peers are tried in their newest versions only. What those old versions are
# told by newer ones below them is not our business, so their deprecations pass.
$(VENV)-lowest/.made: pyproject.toml
	$(PYTHON) -m venv --clear $(VENV)-lowest
	$(VENV)-lowest/bin/python -m pip install --quiet uv
	$(VENV)-lowest/bin/uv pip install --quiet --python $(VENV)-lowest/bin/python --resolution lowest-direct -e ".[all,test]"
	touch $@

lowest: $(VENV)-lowest/.made
	$(VENV)-lowest/bin/python -m pytest -n 2 -W ignore::DeprecationWarning

gallery: $(VENV)/.demo
	$(BIN)/python -m examples

bench: $(VENV)/.dev
	$(BIN)/python -m bench
	$(BIN)/python -m bench.book

clean:
	rm -rf $(VENV) $(VENV)-lowest $(DEMO) build dist .pytest_cache .mypy_cache .ruff_cache
