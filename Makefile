# On a fresh machine with Python 3.11 or newer: `make demo`, `make check`, `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   := demo
unexport PYTHONDONTWRITEBYTECODE  # tests with rewritten assertions, and what children import, are compiled once

.PHONY: help demo check test test-all lowest bridges docs release-check lock emulate lint gallery bench bench-bridges clean

help:
	@echo "make demo      install, and ask whether a UR5 can carry 10 kg, and then 5 kg, along a bundled path"
	@echo "make check     install, then lint, types, import layers and the tests of the core: minutes"
	@echo "make test      install, then lint, types, import layers and all tests but the slow ones"
	@echo "make test-all  the same with the slow oracles"
	@echo "make lowest    install the oldest versions that pyproject.toml allows, and run the tests but the slow ones on them"
	@echo "make bridges   install PyTorch, which is larger than all else, and run the tests of what goes to other packages"
	@echo "make docs      build the documentation site into build/site"
	@echo "make release-check  build wheel and sdist from what is committed, and try them in a fresh environment"
	@echo "make lock      write tools/dev.lock, the versions and hashes that LOCKED=1 installs, as in make test LOCKED=1"
	@echo "make emulate   run kernels for 64-bit ARM under QEMU and for Windows under Wine, and compare their bits with this system's"
	@echo "make gallery   run the numbered examples, and keep their pictures, which the home page of the site shows"
	@echo "make bench     time every kernel beside its peers, and write bench/RESULTS.md"
	@echo "make bench-bridges  install who else computes dynamics in JAX, PyTorch, CasADi and Node, apart, and write bench/BRIDGES.md"
	@echo "make clean     remove what the above made"

$(VENV)/.made:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	touch $@

$(VENV)/.demo: pyproject.toml | $(VENV)/.made
	$(BIN)/python -m pip install --quiet -e ".[plot]"
	touch $@

# LOCKED=1 installs the versions in tools/dev.lock, each compared with its hash, and none beside them.
$(VENV)/.dev: pyproject.toml tools/dev.lock | $(VENV)/.made
ifdef LOCKED
	$(BIN)/python -m pip install --quiet --require-hashes -r tools/dev.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
else
	$(BIN)/python -m pip install --quiet -e ".[dev]"
endif
	touch $@ $(VENV)/.demo

# The first answer is no: exit status 1, a joint is over its limit, and --why says why. The second is yes.
demo: $(VENV)/.demo
	mkdir -p $(DEMO)
	$(BIN)/twistwrench torques ur5 --trajectory demo --payload 10 --why \
	  --overwrite --csv $(DEMO)/torques.csv --plot $(DEMO)/torques.png || [ $$? -eq 1 ]
	$(BIN)/twistwrench torques ur5 --trajectory demo --payload 5

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/basedpyright
	$(BIN)/lint-imports

# One file or two of each tower: a change that breaks the core shows here.
CHECK := tests/lie/test_lie.py tests/bodies/test_screws.py tests/laws/test_laws_of_chapter_8.py tests/kernels/test_kernels.py tests/formats/test_urdf.py \
  tests/model/test_bundled_robots.py tests/statics/test_statics.py tests/meta/test_import.py tests/report/test_torque_report.py

check: lint
	$(BIN)/pytest -n 2 $(CHECK)

test: lint
	$(BIN)/pytest -n 2 --dist loadfile

test-all: lint
	$(BIN)/pytest -n 2 --dist loadfile -m "slow or not slow"

# Run-time extras and what tests need; linters and peers are tried in their newest versions only. What those old versions are
# told by newer ones below them is not our business, so their deprecations pass.
$(VENV)-lowest/.made: pyproject.toml
	$(PYTHON) -m venv --clear $(VENV)-lowest
	$(VENV)-lowest/bin/python -m pip install --quiet uv
	$(VENV)-lowest/bin/uv pip install --quiet --python $(VENV)-lowest/bin/python --resolution lowest-direct -e ".[all,usd,jax,casadi,gymnasium,test]"
	touch $@

lowest: $(VENV)-lowest/.made
	$(VENV)-lowest/bin/python -m pytest -n 2 --dist loadfile -W ignore::DeprecationWarning

bridges: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet -e ".[dev,torch]"
	$(BIN)/pytest -n 2 -m "slow or not slow" tests/bridges

docs: $(VENV)/.dev
	$(BIN)/python docs/prose.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

outputs: $(VENV)/.dev
	$(BIN)/python docs/quantities.py
	$(BIN)/python docs/doubts.py
	$(BIN)/python docs/questions.py
	$(BIN)/python docs/first_calls.py
	$(BIN)/python docs/live.py
	$(BIN)/python docs/outputs.py

release-check: $(VENV)/.dev
	$(BIN)/python -m tools.release_check $(DIST)

# Versions of all that `.[dev]` installs, on every platform and Python, with the hashes of their files.
lock: | $(VENV)/.made
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --quiet --upgrade --extra dev --universal --python-version 3.11 --generate-hashes \
	  --no-annotate --custom-compile-command "make lock" --output-file tools/dev.lock

emulate: $(VENV)/.dev
	$(BIN)/python tools/emulate.py

gallery: $(VENV)/.demo
	$(BIN)/python -m examples

bench: $(VENV)/.dev
	$(BIN)/python -m bench
	$(BIN)/python -m bench.book

# ADAM wants an old JAX, so this has an environment of its own; Node's packages lie in it too.
$(VENV)-bridges/.made: pyproject.toml
	$(PYTHON) -m venv --clear $(VENV)-bridges
	$(VENV)-bridges/bin/python -m pip install --quiet -e ".[bridges-peers]"
	$(VENV)-bridges/bin/npm install --global --prefix $(CURDIR)/$(VENV)-bridges @mujoco/mujoco pinocchio-js
	touch $@

bench-bridges: $(VENV)-bridges/.made
	$(VENV)-bridges/bin/python -m bench.bridges

clean:
	rm -rf $(VENV) $(VENV)-lowest $(VENV)-bridges $(DEMO) build dist .pytest_cache .mypy_cache .ruff_cache
