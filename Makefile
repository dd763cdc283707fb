# `make run` and `make test` do all their own set-up; they need Python 3.11+ and make, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PORT ?= 8017
HOST ?= 127.0.0.1
# A fixed file instead of the newest releases: the two commands stay repeatable.
LOCK := docker/requirements.lock

.PHONY: run test check wheel sdist package-check bench load test-long test-oracle extremes fuzz chaos crowd coverage page thumbnails lock clean help

help: ## Say what each target does
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

$(VENV)/.ready: pyproject.toml $(LOCK) hatch_build.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Fredholm needs Python 3.11 or newer; $$($(PYTHON) --version) was found. Try: make PYTHON=python3.12"; exit 1; }
	@test -x $(BIN)/python || { echo "Setting up $(VENV) …"; $(PYTHON) -m venv $(VENV); }
	@echo "Installing …"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r $(LOCK)
	@FREDHOLM_SKIP_PAGE=1 $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps -e '.[service,postgres]'
	@touch $@

page: $(VENV)/.ready ## Build the page if its sources changed
	@$(BIN)/python hatch_build.py

run: page ## Serve at http://127.0.0.1:8017 and open the page
	@$(BIN)/fredholm serve --host $(HOST) --port $(PORT)

test: page ## Everything a newcomer needs to trust the build
	$(BIN)/python -m pytest

test-long: page ## Long statistics with fresh seeds
	$(BIN)/python -m pytest -m slow

test-oracle: $(VENV)/.ready ## Mitsuba's own render tests, judged on our images
	$(BIN)/python -m pytest -m oracle tests/statistical

check: page ## Formatting, lint, types, page checks
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/python hatch_build.py --check

coverage: $(VENV)/.ready ## What error bars, stop rule and adaptive sampling are worth, measured (half an hour)
	mkdir -p tests/output && $(BIN)/python -m tests.coverage_study | tee tests/output/coverage.txt

bench: $(VENV)/.ready ## Speed and error at equal time against Mitsuba's path, as ratios within one run
	$(BIN)/python -m tests.benchmarks

extremes: $(VENV)/.ready ## Light kept at every scale and distance, with Mitsuba's beside it
	$(BIN)/python -m tests.extremes

fuzz: page ## Twenty thousand mutated uploads with fresh seeds
	$(BIN)/python -m pytest -o faulthandler_timeout=7200 -m fuzz -s tests/faults

chaos: page ## Two hundred faults of all kinds, half on each database: nothing acknowledged is lost
	FREDHOLM_CHAOS_COUNT=$${FREDHOLM_CHAOS_COUNT:-100} $(BIN)/python -m pytest -o faulthandler_timeout=7200 -m slow -s tests/service/test_chaos.py

load: $(VENV)/.ready ## The service under 200 jobs, 50 streams and 20 pollers, as a table
	$(BIN)/python -m tests.load

crowd: $(VENV)/.ready ## The service among hostile clients of each kind, as a table
	$(BIN)/python -m tests.crowd

thumbnails: $(VENV)/.ready ## Render the gallery's thumbnails again
	$(BIN)/python -m renderer.scene.gallery.make_thumbnails

wheel: page ## dist/*.whl, with the built page in it
	@rm -f dist/*.whl && $(BIN)/python -m hatchling build -t wheel -d dist

sdist: page ## dist/*.tar.gz, from which a wheel is made without Node
	@rm -f dist/*.tar.gz && $(BIN)/python -m hatchling build -t sdist -d dist

package-check: wheel sdist ## Install both into an empty environment, and use them
	$(BIN)/python -m tests.empty_environment dist/*.whl dist/*.tar.gz

lock: ## Write $(LOCK) from what pyproject.toml allows
	@rm -rf .lock-venv && $(PYTHON) -m venv .lock-venv
	@.lock-venv/bin/python -m pip install --quiet --upgrade pip
	@FREDHOLM_SKIP_PAGE=1 .lock-venv/bin/python -m pip install --quiet --group dev '.[postgres]'
	@{ echo "# Written by make lock."; .lock-venv/bin/python -m pip freeze --exclude fredholm; } > $(LOCK)
	@rm -rf .lock-venv

clean: ## Remove what was built
	rm -rf $(VENV) service/static web/node_modules
