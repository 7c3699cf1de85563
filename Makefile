# Each target makes .venv from the locks by itself: no other step is needed. demo and gate install what
# running needs, the others what development needs besides.
# PYTHON names the interpreter to make it with: make test PYTHON=python3.12

PYTHON ?= python3
# How long make fuzz searches, in all.
MINUTES ?= 10
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
INSTALLED_DEV := $(VENV)/.installed-dev
AUDIT := $(VENV)-audit
PIP := $(BIN)/python -m pip install -qq --disable-pip-version-check --no-input
UV := $(BIN)/uv pip install --quiet --python $(BIN)/python
# uv takes a fifth of pip's time. It reads none of pip's settings, so that it may reach no package index where pip does:
# then pip installs, and says what is wrong if it cannot either.
install = $(UV) $(1) 2>/dev/null || $(PIP) $(1)
LOCK := uv pip compile --universal --python-version 3.11 --generate-hashes --no-header --no-annotate --quiet

.PHONY: help demo test test-long check lint format types imports rooms bench bench-loop chaos drawn failing fuzz mutation \
	soak gate reference trials audit lock clean

help: ## list these targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' Makefile | expand -t 20

demo: $(INSTALLED) ## run the quickstart campaign on the simulated rig, write its report to runs/demo
	@$(BIN)/rig run quickstart --out runs/demo; status=$$?; \
	if [ -f runs/demo/report.html ]; then echo "Open the report: $(CURDIR)/runs/demo/report.html"; fi; \
	exit $$status

# Where Python may keep no bytecode, every process that the tests start compiles all sources anew.
unexport PYTHONDONTWRITEBYTECODE

# A file's tests share what they set up, so that files are what the workers share out, in the order
# that tests/conftest.py gives them. Four of them on two processors: tests of processes mostly wait.
test: $(INSTALLED_DEV) ## run the tests
	@$(BIN)/python -m pytest -n 4 --dist loadfile --no-loadscope-reorder

test-long: $(INSTALLED_DEV) ## run the tests that test leaves out for their length
	@$(BIN)/python -m pytest -n 2 -m long

check: lint format types imports rooms ## lint, format, types, faces and layers, sizes (make -k check: all of them)

lint: $(INSTALLED_DEV)
	@$(BIN)/ruff check

format: $(INSTALLED_DEV)
	@$(BIN)/ruff format --check

types: $(INSTALLED_DEV)
	@$(BIN)/mypy

imports: $(INSTALLED_DEV)
	@PYTHONPATH=. $(BIN)/lint-imports --no-logo

rooms: $(INSTALLED_DEV)
	@$(BIN)/python -m tools.rooms

bench: $(INSTALLED_DEV) ## measure filter, plant, campaign, lanes and start-up against their references; AGAINST=../before compares campaigns
	@$(BIN)/python -m tools.bench $(if $(AGAINST),--against $(AGAINST))

bench-loop: $(INSTALLED_DEV) ## measure the loop against cyclictest: idle, with the whole chain, and beside readers of the stream
	@$(BIN)/python -m tools.bench.loop
	@$(BIN)/python -m tools.bench.readers

chaos: $(INSTALLED_DEV) ## let everything fail that can, on the emulated rig, for docs/safety.md; kill campaigns and go on
	@$(BIN)/python -m tools.chaos
	@$(BIN)/python -m tools.chaos.endurance

drawn: $(INSTALLED_DEV) ## play 300 drawn cases of two faults on the emulated rig (goes on where it was stopped)
	@$(BIN)/python -m tools.chaos.drawn

mutation: $(INSTALLED_DEV) ## change the code that keeps the rig safe, one place at a time, and see whether a test notices
	@NUMBA_DISABLE_JIT=1 $(BIN)/python -m tools.mutation

soak: $(INSTALLED_DEV) ## 30 min on the emulated rig, 24 h simulated: do memory, descriptors or disk grow?
	@$(BIN)/python -m tools.chaos.soak

failing: $(INSTALLED_DEV) ## let each call of the system fail once in turn, simulated and emulated, for docs/failing.md (hours)
	@$(BIN)/python -m tools.failing --all

fuzz: $(INSTALLED_DEV) ## feed all readers with bytes that nobody foresaw, for MINUTES (10), guided by coverage
	@$(BIN)/python -c 'import atheris' 2>/dev/null || $(call install,--only-binary :all: --require-hashes -r requirements-fuzz-lock.txt)
	@$(BIN)/python -m tools.fuzz --minutes $(MINUTES)

trials: $(INSTALLED_DEV) ## try the gap workflow on 200 rigs with hidden effects (hours; goes on where it was stopped)
	@$(BIN)/python -m tools.hidden_effects

gate: $(INSTALLED) ## run the quickstart campaign and compare its figures with the reference in .ci
	@$(BIN)/rig run quickstart --pace fast --out runs/ci
	@$(BIN)/rig runs compare .ci/reference/quickstart runs/ci --out runs/ci/compared.html

reference: $(INSTALLED) ## make the reference of `make gate` anew, to be looked at and committed
	@$(BIN)/rig run quickstart --pace fast --out runs/reference
	@$(BIN)/python -m tools.reference_run runs/reference .ci/reference/quickstart

audit: $(INSTALLED) $(AUDIT)/.installed ## look for known vulnerabilities, judge licences, write the bill of materials to dist
	@$(AUDIT)/bin/python -m tools.audit

lock: ## resolve the dependencies of pyproject.toml anew into the locks (needs uv)
	@command -v uv >/dev/null || { \
	    echo "make lock needs uv (https://docs.astral.sh/uv); nothing else does." >&2; exit 1; }
	$(LOCK) --group install -o requirements-install-lock.txt
	$(LOCK) --group build pyproject.toml -o requirements-lock.txt
	$(LOCK) --group audit -o requirements-audit-lock.txt
	$(LOCK) --group dev --constraint requirements-lock.txt pyproject.toml -o requirements-dev-lock.txt
	$(LOCK) --group fuzz -o requirements-fuzz-lock.txt

clean: ## remove .venv, caches and runs/demo
	rm -rf $(VENV) $(AUDIT) runs/demo dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamp comes last, so that an interrupted installation starts over from an empty .venv; wheels
# only, so that no compiler is needed.
$(INSTALLED): requirements-install-lock.txt requirements-lock.txt pyproject.toml
	@command -v $(PYTHON) >/dev/null || { \
	    echo "$(PYTHON) is not installed; Python 3.11 or newer is needed, or name one: PYTHON=..." >&2; \
	    exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "$$($(PYTHON) --version 2>&1) is too old; Python 3.11 or newer is needed." \
	        "Name one: make PYTHON=python3.12 ..." >&2; \
	    exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "$(PYTHON) lacks the venv module; on Debian and Ubuntu: sudo apt install python3-venv" >&2; \
	    exit 1; }
	@echo "Installing what running needs into $(VENV) (once) ..."
	@[ -f $@ ] || $(PYTHON) -m venv --clear $(VENV)
	@rm -f $@
	@$(PIP) --only-binary :all: --require-hashes -r requirements-install-lock.txt 2>/dev/null || true
	@$(call install,--only-binary :all: --require-hashes -r requirements-lock.txt)
	@$(call install,--no-deps --no-build-isolation -e .)
	@touch $@

$(INSTALLED_DEV): $(INSTALLED) requirements-dev-lock.txt
	@echo "Adding what development needs (once) ..."
	@rm -f $@
	@$(call install,--only-binary :all: --require-hashes -r requirements-dev-lock.txt)
	@touch $@

# An environment of its own, so that what audits is not audited, and slows no other target.
$(AUDIT)/.installed: requirements-audit-lock.txt
	@echo "Installing what audits into $(AUDIT) (once) ..."
	@$(PYTHON) -m venv --clear $(AUDIT)
	@$(AUDIT)/bin/python -m pip install -qq --disable-pip-version-check --no-input --only-binary :all: --require-hashes -r requirements-audit-lock.txt
	@touch $@
