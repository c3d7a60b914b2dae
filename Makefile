# Two commands do everything on a fresh machine:   make demo   and   make test
#
# Each makes .venv, installs what it needs there (once; again when pyproject.toml changes) and runs.
# Another Python:  make test PYTHON=python3.12 VENV=.venv-3.12        Fewer tests:  make suite ARGS=tests/rtu

# Python keeps what it has compiled, also where the environment says otherwise: the tests start it hundreds of times.
unexport PYTHONDONTWRITEBYTECODE

VENV   ?= .venv
BIN    := $(VENV)/bin
NEW    := import sys; sys.exit(sys.version_info < (3, 11))
# Tests run in eight processes, one file at a time in each, because many of them wait. One process: WORKERS=
WORKERS ?= -n 8 --dist loadfile --no-loadscope-reorder
# Seconds after which a test that hangs fails, and says where its threads stand.
LONGEST ?= 600
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
            $$p -c '$(NEW)' 2>/dev/null && echo $$p && exit; done; echo python3)

help: ## show this list
	@sed -nE 's/^([a-z-]+):.*## (.*)/make \1	\2/p' Makefile | expand -t 22

demo: $(VENV)/installed-all ## watch it work: three devices, two protocols, no hardware
	@$(BIN)/barewire demo

check: style types ## what to run while you work, in less than a minute: format, lint, types, the tests that do not wait
	$(BIN)/pytest -rs -n auto --dist loadfile -m "not long and not proof" --ignore=tests/io --ignore=tests/workbench/cli \
	  --ignore=tests/workbench/live --ignore=tests/interop $(ARGS)

test: style types suite ## everything a change must pass: format, lint, types, then all tests

style: $(VENV)/installed-dev ## format check and lint
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/installed-dev ## strict types
	$(BIN)/mypy

suite: $(VENV)/installed-dev ## layers, unit tests, vectors, doc examples, interop; ARGS= for pytest
	$(BIN)/pytest -rs $(WORKERS) --timeout=$(LONGEST) $(ARGS)

pyodide: $(VENV)/installed-dev ## tests of everything that needs no ports on CPython 3.14, as Pyodide in node
	@VENV=$(VENV) tests/pyodide/run $(ARGS)

micropython: $(VENV)/installed-dev ## the small edition: vectors and talks on MicroPython in node, sizes
	@PYTHON=$(abspath $(BIN))/python $(BIN)/python -m tools.micropython vectors
	@$(BIN)/python -m tools.micropython sizes --check
	@PYTHON=$(abspath $(BIN))/python $(BIN)/python -m tools.micropython talks

bench: $(VENV)/installed-bench ## our work beside that of other libraries and hand-written code; writes docs/reference/speed.md
	@mkdir -p build
	$(BIN)/python -m pytest bench -W default -rs --benchmark-columns=median,iqr,ops --benchmark-sort=name \
	  --benchmark-json=build/bench.json $(ARGS)
	@$(BIN)/python tools/bench_page.py build/bench.json

small: $(VENV)/installed-bench ## memory, start, processor time and disk of small programs, beside others; writes docs/reference/small.md; MBUSD=path
	@$(BIN)/python -m bench.small $(ARGS)

proof: $(VENV)/installed-dev $(VENV)/installed-bench ## whole searches, then every order of late answers, ours and those of other clients; writes docs/explanation/late-answers.md
	$(BIN)/pytest -rs $(WORKERS) --timeout=$(LONGEST) -m proof
	@$(BIN)/python tools/late_answers.py $(ARGS)

scoreboard: $(VENV)/installed-dev peers ## what other stacks make of the vectors; writes docs/reference/scoreboard.md; ARGS=names
	@$(BIN)/python tools/scoreboard.py $(ARGS)

# What adapters need and pip does not install.
PEERS := vectors/peers
peers: $(VENV)/bin/pip
	@cmp -s $(PEERS)/package-lock.json $(PEERS)/node_modules/installed || \
	  (export PYTHON=$(abspath $(BIN))/python && cd $(PEERS) && \
	  ../../tools/with-node npm ci --loglevel=error --no-audit --no-fund --omit=optional >/dev/null && \
	  cp package-lock.json node_modules/installed)

modbus-connection: ## the tests of Home Assistant's Modbus layer with our backend; writes docs/how-to/home-assistant.md; PYTHON=python3.12
	@$(PYTHON) tools/modbus_connection.py

pictures: $(VENV)/installed-dev ## the pictures of the documentation, in docs/pictures
	@$(BIN)/python -m tools.pictures

docs: $(VENV)/installed-docs ## the site of the documentation, in build/site
	@$(BIN)/python -m tools.website

docs-links: $(VENV)/installed-docs ## which links of the documentation to other sites are dead
	@$(BIN)/python -m tools.website linkcheck

hostile: $(VENV)/installed-dev ## CANopen devices after every configuration of two steps and random ones; ARGS=--help
	@$(BIN)/python tools/hostile_master.py $(ARGS)

gateway-lab: $(VENV)/installed-dev ## the gateway beside a relay and mbusd, and under faults; writes docs/reference/gateway.md; MBUSD=path
	@$(BIN)/python -m tools.gateway_lab $(ARGS)

small-machine: $(VENV)/installed-dev ## from sensor to broker with 64 MB and a fifth of a core, in a control group; needs root; ARGS=--help
	@$(BIN)/python -m tools.small_machine $(ARGS)

gateway-clients: $(VENV)/installed-dev ## what the pages Node-RED, Telegraf and ESPHome say, with those programs; Python 3.12; TELEGRAF=path
	@TELEGRAF=$(TELEGRAF) $(BIN)/python -m tools.gateway_clients

plant: $(VENV)/installed-dev ## 127 CANopen nodes booted, configured and run with SYNC at 100 Hz, and their load; ARGS=--help
	@$(BIN)/python -m bench.plant $(ARGS)

vectors-release: $(VENV)/installed-dev ## the vectors as an archive and as a package of npm, in dist/
	@$(BIN)/python -m tools.vectors_release $(ARGS)

release: $(VENV)/installed-dev ## wheels, zipapp, program and vectors in dist/release, each tried; ARGS="--files URL", or --dry-run
	@$(BIN)/python -m tools.release $(ARGS)

vectors-speed: $(VENV)/installed-dev ## how long a run of all cases takes with a compiled adapter; ARGS=--help
	@$(BIN)/python -m tools.vectors_speed $(ARGS)

vectors-mutants: $(VENV)/installed-dev ## which changes of the reference of the vectors no case notices
	@$(BIN)/python -m tools.vectors_mutants $(ARGS)

vectors-mistakes: $(VENV)/installed-dev ## which mistakes, planted in three stacks, no case notices; ARGS=words
	@$(BIN)/python -m tools.vectors_mistakes $(ARGS)

mutants: $(VENV)/installed-mutants ## which changes of the core no test notices; writes docs/reference/mutation.md
	@$(BIN)/python tools/mutants.py $(ARGS)

format: $(VENV)/installed-dev ## put the code in its form
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean: ## remove what was built or installed here
	rm -rf .venv .venv-* build dist mutants src/*.egg-info workbench/build workbench/src/*.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis .benchmarks
	find src workbench tests bench -name __pycache__ -prune -exec rm -rf {} +

# One stamp file for each extra: $(VENV)/installed-dev says that barewire[dev] is installed there.
$(VENV)/installed-%: pyproject.toml workbench/pyproject.toml | $(VENV)/bin/pip
	@echo "installing barewire[$*] and barewire-workbench into $(VENV)"
	@rm -rf src/*.egg-info workbench/src/*.egg-info # setuptools would keep old names in them
	@$(BIN)/python -m pip install -qq --editable '.[$*]' --editable ./workbench
	@touch $@

$(VENV)/bin/pip:
	@$(PYTHON) -c '$(NEW)' 2>/dev/null || { echo "barewire needs Python 3.11 or later; \"$(PYTHON) --version\" says:" \
	  "$$($(PYTHON) --version 2>&1). Name another one: make PYTHON=/path/to/python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)

.PHONY: help demo check test style types suite pyodide micropython bench small proof scoreboard peers modbus-connection pictures docs docs-links hostile gateway-lab gateway-clients small-machine plant vectors-release release vectors-mutants vectors-mistakes mutants format clean
.NOTPARALLEL:
