# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0

PYTHON ?= python3
VENV ?= .venv
# Added to every `pip install`, to name another index or a folder of wheels.
PIP_ARGS ?=
DEMO_ARGS ?=
TEST_ARGS ?=
# Two processes; tests of one file stay in one, since they share what is costly to make.
TEST_WORKERS ?= -n 2 --dist loadfile
BENCH_ARGS ?= latency
IDENTITY_ARGS ?= HEAD~1

# Other people's predictors, to compare with: pins that exclude those of adk_ros.
PEERS := .venv-peers
PEERS_PYTHON ?= python3.11

BIN := $(VENV)/bin
RUNTIME := $(VENV)/.runtime-installed
IMPORT := $(VENV)/.import-installed
FLEET := $(VENV)/.fleet-installed
TESTING := $(VENV)/.testing-installed
PACKAGE := setup.py setup.cfg pyproject.toml
PIP_INSTALL = $(BIN)/python -m pip install --disable-pip-version-check $(PIP_ARGS)

# The ROS wheels set this for the children of a Python that has found them already.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Only Fast DDS is among the wheels.
unexport RMW_IMPLEMENTATION
ifdef AMENT_PREFIX_PATH
# A sourced ROS would mix its libraries with those of the wheels.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH
endif

# Runs under whatever `PYTHON` is, so it must not assume Python 3.10.
define CHECK
import platform, sys
version = sys.version_info[:2]
machine = sys.platform + " " + platform.machine()
if version < (3, 10):
    sys.exit("adk_ros needs Python 3.10 or newer, and $(PYTHON) is %d.%d:"
             " try `make PYTHON=python3.11 ...`" % version)
if machine != "linux x86_64" or version > (3, 14):
    sys.exit("ROS 2 Jazzy comes as wheels for CPython 3.10 to 3.14 on linux x86_64, and this is %d.%d"
             " on %s: install Jazzy from packages, see README.md" % (version + (machine,)))
try:
    import pip, venv
except ImportError as error:
    sys.exit("$(PYTHON) has no %s: on Debian and Ubuntu, `apt install python3-%s`"
             % (error.name, error.name))
endef
export CHECK

# Without it each worker and each child of the tests compiles all sources anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help install import fleet demo test test-slow test-all fuzz lint docs bench peers colcon clean distclean

help: ## Say what can be made
	@echo "make TARGET [PYTHON=python3.11] [PIP_ARGS=...]"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

install: $(RUNTIME) ## Make .venv with the `adk` command and all that it needs

import: $(IMPORT) ## Add to .venv what `adk import` and `adk export` need: Parquet, MDF, CAN logs, units

fleet: $(FLEET) ## Add to .venv what `adk fleet` needs: Dask, Parquet, object stores

demo: $(RUNTIME) ## Train, run the live node, play a bag to it, score it (DEMO_ARGS=...)
	@$(BIN)/adk demo $(DEMO_ARGS)

test: $(TESTING) ## Run the tests that take seconds, the live node's included (TEST_ARGS="-k node -x")
	@$(BIN)/python -m pytest $(TEST_WORKERS) -m "not slow" $(TEST_ARGS)

test-slow: $(TESTING) ## Run the tests that `make test` leaves out
	@$(BIN)/python -m pytest $(TEST_WORKERS) -m slow $(TEST_ARGS)

test-all: test test-slow ## Run all tests

fuzz: export FUZZ_SECONDS ?= 600
fuzz: export KILLS ?= 50
fuzz: $(TESTING) ## Alter inputs and kill processes at random (FUZZ_SECONDS=600, KILLS=50, FUZZ_SEED=0)
	@$(BIN)/python -m pytest $(TEST_WORKERS) test/fuzz $(TEST_ARGS)

lint: $(TESTING) ## Check style and types
	@$(BIN)/ruff check .
	@$(BIN)/mypy

docs: $(TESTING) ## Generate the reference pages and build the site in site/, warnings as errors
	@$(BIN)/python scripts/generate_docs.py
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

identity: $(RUNTIME) ## Compare results with an earlier revision (IDENTITY_ARGS="8313453 --cases DIR")
	@$(BIN)/python scripts/check_identity.py $(IDENTITY_ARGS)

bench: $(TESTING) ## Measure (BENCH_ARGS="live", "latency --json")
	@$(BIN)/adk bench $(BENCH_ARGS)

peers: $(PEERS)/.peers-installed ## Make .venv-peers with the libraries that `adk bench` compares with

colcon: $(TESTING) ## Build as a ROS workspace would, in a scratch folder, and start the node's --help
	@set -e; scratch=$$(mktemp -d); trap 'rm -rf "$$scratch"' EXIT; \
	$(BIN)/colcon --log-base "$$scratch/log" build --paths . \
	    --build-base "$$scratch/build" --install-base "$$scratch/install"; \
	. "$$scratch/install/setup.sh"; \
	ls "$$scratch/install/adk_ros/lib/adk_ros"; \
	"$$scratch/install/adk_ros/lib/adk_ros/predictor" --help

clean: ## Remove what was built and cached, but for .venv
	rm -rf build install log site demo_out paper_out *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find adk_ros launch test -name __pycache__ -prune -exec rm -rf {} +

distclean: clean ## Remove .venv as well
	rm -rf $(VENV) $(PEERS)

# venv without pip, and pip from outside: Debian and Ubuntu keep ensurepip in a package of its own.
$(BIN)/python:
	@$(PYTHON) -c "$$CHECK"
	$(PYTHON) -m venv --clear --without-pip $(VENV)

$(BIN)/pip: | $(BIN)/python
	@$(PYTHON) -m pip --python $(BIN)/python install -q --disable-pip-version-check $(PIP_ARGS) \
	    -c requirements/constraints.txt pip || $(BIN)/python -m ensurepip -q || \
	    { echo "No pip in $(VENV), for the reason above. If that is \`no such option: --python\`:" \
	           "$(PYTHON) -m pip install --upgrade pip" >&2; exit 1; }

RUNTIME_PINS := $(addprefix requirements/,runtime.txt python.txt ros.txt constraints.txt)

$(RUNTIME): $(RUNTIME_PINS) $(PACKAGE) | $(BIN)/pip
	$(PIP_INSTALL) -r requirements/runtime.txt
	$(PIP_INSTALL) --no-deps --no-build-isolation --editable .
	-@$(BIN)/adk compile
	@touch $@

$(IMPORT): requirements/import.txt requirements/constraints.txt $(RUNTIME)
	$(PIP_INSTALL) -r requirements/import.txt
	@touch $@

$(FLEET): requirements/fleet.txt requirements/constraints.txt $(RUNTIME)
	$(PIP_INSTALL) -r requirements/fleet.txt
	@touch $@

$(TESTING): requirements/test.txt requirements/import.txt requirements/fleet.txt requirements/docs.txt $(RUNTIME)
	$(PIP_INSTALL) -r requirements/test.txt
	@touch $@

# One of the peers has wheels for no other Python. The list is complete, and shorter than what they
# ask for: see there.
$(PEERS)/.peers-installed: requirements/peers.txt | $(BIN)/pip
	@$(PEERS_PYTHON) -c "import sys; sys.exit(sys.version_info[:2] != (3, 11))" || \
	    { echo "The peers need Python 3.11: \`make peers PEERS_PYTHON=...\`" >&2; exit 1; }
	$(PEERS_PYTHON) -m venv --clear --without-pip $(PEERS)
	@echo "*" > $(PEERS)/.gitignore
	$(BIN)/python -m pip --python $(PEERS)/bin/python install --disable-pip-version-check \
	    $(PIP_ARGS) --no-deps --only-binary :all: -r requirements/peers.txt
	@touch $@
