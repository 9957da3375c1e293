# SPDX-License-Identifier: Apache-2.0
# make demo | test | setup | lint | test-slow | test-colcon | bench | clean

SHELL := /bin/sh
.ONESHELL:
.SHELLFLAGS := -euc
.DEFAULT_GOAL := help

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
INTERFACES := $(VENV)/.interfaces
LOG := $(VENV)/setup.log
JOBS ?= 2
LIVE ?=
PYTEST_ARGS ?=

# What an editable installation copies; Python modules are used from the checkout.
INSTALLED := pyproject.toml \
  $(foreach package,common sim rig rbdo,$(wildcard cwmav_$(package)/package.xml cwmav_$(package)/config/* \
  cwmav_$(package)/launch/*.py cwmav_$(package)/lib/*))

# install <what for> <pip arguments>: quiet, with the end of the log when it fails
define PIP_INSTALL
install() {
  echo "setup: $$1"; shift
  if ! $(BIN)/python -m pip install --disable-pip-version-check "$$@" > $(LOG) 2>&1; then
    echo "setup: pip install $$* failed; the end of $(LOG):" >&2
    tail -n 25 $(LOG) >&2
    exit 1
  fi
}
endef

.PHONY: help setup demo test test-slow test-colcon verify-long bench lint clean

help:
	@echo "make demo         run the three nodes on a bundled recording and optimise (LIVE=1: live simulations only)"
	echo "make test         run the tests"
	echo "make setup        install everything into $(VENV)"
	echo "make lint         check style, types and layers"
	echo "make test-slow    run the long tests, make test-colcon the colcon build, make bench the speed measurements"
	echo "make verify-long  run every verification case, hours on two cores, and keep the results in docs/reference"
	echo "make clean        remove $(VENV) and what the tools left behind"

setup: $(READY) $(INTERFACES)

$(READY): $(INSTALLED)
	@python=""
	for candidate in $(PYTHON) python3 python3.13 python3.12 python3.11; do
	  if "$$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
	    python=$$candidate; break
	  fi
	done
	missing=""
	[ -n "$$python" ] || missing="$$missing\n  Python 3.11 or later (found: $$(python3 --version 2>&1 || true))"
	if [ -n "$$python" ] && ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then
	  missing="$$missing\n  the venv module of $$python (Debian, Ubuntu: apt install python3-venv)"
	fi
	command -v $(CC) >/dev/null 2>&1 || missing="$$missing\n  a C compiler, $(CC) (Debian, Ubuntu: apt install build-essential)"
	command -v $(CXX) >/dev/null 2>&1 || missing="$$missing\n  a C++ compiler, $(CXX) (Debian, Ubuntu: apt install build-essential)"
	if [ -n "$$missing" ]; then
	  printf 'setup: missing on this machine:%b\n' "$$missing" >&2
	  exit 1
	fi
	if ! [ -x $(BIN)/python ] || ! $(BIN)/python -c 'import pip' 2>/dev/null; then
	  echo "setup: making $(VENV) with $$("$$python" --version)"
	  "$$python" -m venv --clear $(VENV)
	fi
	$(PIP_INSTALL)
	install "installing the programs and their libraries" --editable '.[ros,dev]'
	touch $@

$(INTERFACES): $(shell find msgs_schema -type f) | $(READY)
	@$(PIP_INSTALL)
	install "building the ROS 2 interfaces (about two minutes)" --force-reinstall --no-deps ./msgs_schema
	touch $@

demo: setup
	@$(BIN)/python -m cwmav_rbdo.demo $(if $(LIVE),--live)

test: setup
	@$(BIN)/python -m pytest -n $(JOBS) --dist worksteal $(PYTEST_ARGS)

test-slow: setup
	@$(BIN)/python -m pytest -n $(JOBS) --dist worksteal -m slow $(PYTEST_ARGS)

test-colcon: setup
	@$(PIP_INSTALL)
	install "installing colcon and the generators of the interfaces" colcon-common-extensions $$($(BIN)/python -c \
	  "import tomllib; print(*tomllib.load(open('msgs_schema/pyproject.toml', 'rb'))['build-system']['requires'])")
	$(BIN)/python -m pytest -m colcon $(PYTEST_ARGS)

verify-long: setup
	@$(BIN)/cwmav-sim verify --all --record docs/reference

bench: setup
	@$(PIP_INSTALL)
	install "installing the peers of the benchmarks" --editable '.[ros,dev,bench]'
	$(BIN)/python -m pytest -m bench $(if $(RECORD),--record-benchmarks $(RECORD)) $(PYTEST_ARGS) tests/bench

lint: setup
	@$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	@rm -rf $(VENV) build install log dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
