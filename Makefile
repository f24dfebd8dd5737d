# make demo    environment, install, a UR5 under load and the paper's platform into report/
# make test    environment with all tools, then every check; slow repetitions of tests are left out
# The other targets: thorough (every test), lint, docs, fuzz, benchmark, release-check, lock, clean. Needs Python 3.11 or newer, and make.

PYTHON ?= python3
VENV ?= .venv
# Each process takes its half in order: a file's tests share what is recorded, loaded and opened, and
# the files of a folder its browser. Who is done takes half of what the other one has left.
PYTEST_ARGS ?= -n 2 --dist worksteal
LOCK_ARGS ?=

PY := $(VENV)/bin/python
# Where a lock carries hashes, pip takes no file without its own.
# What nobody imports is not compiled; what is, is compiled when it is imported. Locks are whole: --no-deps.
PIP := $(PY) -m pip --disable-pip-version-check -qq install --no-compile
RUNTIME := $(VENV)/runtime.stamp
DEV := $(VENV)/dev.stamp

# What a shell has set up for another Python (ROS, say) must not leak into this environment.
unexport PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE PIP_USER PIP_TARGET PIP_PREFIX
# 6x6 matrices gain nothing from threads, and two test processes share two cores.
export OMP_NUM_THREADS := 1

# An environment whose Python has gone is made anew.
$(shell [ -x $(PY) ] || rm -f $(RUNTIME) $(DEV))

.DEFAULT_GOAL := help
.NOTPARALLEL:
.DELETE_ON_ERROR:
.PHONY: help demo test lint format-check types docs pytest thorough fuzz benchmark screenshot release-check lock clean

help:
	@sed -n '1,3s/^# //p' Makefile

# -- environment ---------------------------------------------------------------------------

define check_python
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "cartstiff needs Python 3.11 or newer as '$(PYTHON)', found:" \
	    "$$($(PYTHON) --version 2>&1 | tail -n 1); try: make PYTHON=python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "'$(PYTHON)' cannot make virtual environments; on Debian and Ubuntu:" \
	    "apt install python3-venv" >&2; exit 1; }
endef

# What is installed: the locks, and this package, which is found where it stands.
LOCKED := requirements.lock pyproject.toml src/cartstiff/version.py

$(PY):
	$(check_python)
	@$(PYTHON) -m venv --clear $(VENV)

$(RUNTIME): $(LOCKED) | $(PY)
	@echo "Installing cartstiff and its locked dependencies into $(VENV)/ (a few minutes at first)"
	@$(PIP) --no-deps -r requirements.lock
	@$(PIP) --no-deps --no-build-isolation -e .
	@touch $@

# The tools alone, beside the packages that cartstiff needs; then what is left of the whole lock.
$(DEV): requirements-dev.lock $(LOCKED) | $(PY)
	@echo "Installing the development tools into $(VENV)/"
	@awk 'NR == FNR { known[$$1]; next } /^[^ #]/ { skip = $$1 in known } !skip' \
	  requirements.lock requirements-dev.lock > $(VENV)/tools.lock
	@$(PIP) --no-deps -r $(VENV)/tools.lock & tools=$$!; \
	  $(MAKE) --no-print-directory $(RUNTIME) || exit 1; wait $$tools
	@$(PIP) --no-deps -r requirements-dev.lock
	@$(PY) -m pip check
	@touch $@

# -- for users -----------------------------------------------------------------------------

demo: $(RUNTIME)
	@$(PY) tools/demo_report.py report

# -- for developers ------------------------------------------------------------------------

# All checks run even if one fails; the exit status says whether any did. `make test ROOM=statics` runs
# the test files nearest to that room of src/cartstiff, without their slow cases, and builds no docs.
ROOM ?=
test: export CARTSTIFF_REQUIRE_BROWSER := 1
test: export CARTSTIFF_BUILT_DOCS := docs/_build/html
test: $(DEV)
ifneq ($(ROOM),)
	@$(MAKE) --no-print-directory --keep-going lint format-check types pytest
else
	@tools/provide_browser.sh $(PY) & browser=$$!; \
	  $(MAKE) --no-print-directory --keep-going lint format-check types & checks=$$!; ok=0; \
	  $(MAKE) --no-print-directory docs || ok=1; wait $$checks || ok=1; wait $$browser; \
	  $(MAKE) --no-print-directory pytest || ok=1; exit $$ok
endif

lint: $(DEV)
	@echo "== ruff check"
	@$(PY) -m ruff check .
	@echo "== the page's JavaScript"
	@tools/page/check.sh

format-check: $(DEV)
	@echo "== ruff format --check"
	@$(PY) -m ruff format --check .

types: $(DEV)
	@echo "== mypy"
	@$(PY) -m mypy

docs: $(DEV)
	@echo "== docs"
	@if [ -f docs/conf.py ]; then \
	  rm -rf docs/_build && $(PY) -m sphinx -W --keep-going -q -b html docs docs/_build/html && \
	  echo "Wrote docs/_build/html/index.html"; \
	else echo "none yet"; fi

pytest: $(DEV)
	@echo "== pytest"
	@$(if $(ROOM),CARTSTIFF_QUICK=1) $(PY) -m pytest $(PYTEST_ARGS) \
	  $(if $(ROOM),$$($(PY) tools/room_tests.py $(ROOM)))

# Every case of every test, before a release and each night; `make test` leaves out tests/thorough.txt.
thorough: export CARTSTIFF_THOROUGH := 1
thorough: test

# Broken and odd input of every kind; FUZZ_ARGS="--count 2000 --seed 7" for other numbers.
FUZZ_ARGS ?= --count 100000
fuzz: $(DEV)
	@$(PY) tools/fuzz.py $(FUZZ_ARGS)

# A few minutes, on a machine with nothing else to do.
benchmark: $(DEV)
	@$(PIP) -r benchmarks/requirements.txt
	@$(PY) benchmarks/posture.py
	@$(PY) benchmarks/many_postures.py
	@$(PY) benchmarks/closed_chain.py
	@$(PY) benchmarks/page.py
	@$(PY) benchmarks/maps.py

# The picture of the page in the README and the documentation.
screenshot: $(DEV)
	@tools/provide_browser.sh $(PY)
	@$(PY) tools/screenshot.py

# Wheel and sdist, installed into empty environments and used there; the suite with the lowest releases.
release-check: $(DEV)
	@$(PY) tools/check_release.py --lowest -o dist

# Re-resolve after a change of pyproject.toml; LOCK_ARGS=--upgrade takes newer releases.
lock:
	$(check_python)
	@[ -x $(VENV)/lock/bin/python ] || $(PYTHON) -m venv $(VENV)/lock
	@$(VENV)/lock/bin/python -m pip --disable-pip-version-check -qq install uv
	@compile="$(VENV)/lock/bin/uv pip compile --quiet --universal --python-version 3.11 \
	  --no-annotate --generate-hashes --extra robots --extra maps --extra mjcf --extra xacro $(LOCK_ARGS) pyproject.toml"; \
	$$compile --custom-compile-command "make lock" --group build -o requirements.lock && \
	$$compile --custom-compile-command "make lock" --group dev \
	  -c requirements.lock -o requirements-dev.lock
	@echo "Wrote requirements.lock and requirements-dev.lock"

clean:
	rm -rf $(VENV) report build dist docs/_build .mypy_cache .pytest_cache .ruff_cache .hypothesis
