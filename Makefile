# Every target sets up .venv by itself and needs nothing but Python 3.11 to 3.13, git and make.

BIN := .venv/bin
STAMP := .venv/.installed
DEMO := build/demo
HOURS := 24
STARTED := $(shell date +%s)
# More workers than the fewest cores: many tests wait for a device or a daemon most of the time.
WORKERS := --numprocesses 3 --dist worksteal

# Where it is set, each of the processes that tests start compiles anew whatever it imports.
unexport PYTHONDONTWRITEBYTECODE
# As the daemon and the commands have it: more threads only wait, on processors that others need.
export OPENBLAS_NUM_THREADS := 1

.PHONY: help demo docs docs-test compiled test test-compiled test-all test-lowest coverage stress faults export-code mutants chaos liars soak firmware board vm peers epics \
	bluesky pymodaq pymmcore qudi browser screenshots fuzz schemathesis check lint audit wheel release bench bench-peers figures lock clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-12s %s\n", $$1, $$2 }' Makefile

demo: $(STAMP) ## run the paper's experiment on the simulated rig and write a report
	@ready=$$(date +%s); \
	$(BIN)/piezod demo --out $(DEMO) && \
	echo "make demo: $$((ready - $(STARTED))) s to set up, $$(($$(date +%s) - ready)) s to run"

test: $(STAMP) ## run the tests
	$(BIN)/python -m pytest $(WORKERS)

compiled: $(STAMP) ## compile what a cycle runs into build/compiled (some minutes; needs a C compiler)
	rm -rf build/compiled build/compiled-wheel
	PIEZOD_COMPILE=1 $(BIN)/python -m build --wheel --no-isolation --outdir build/compiled-wheel .
	$(BIN)/python -m zipfile -e build/compiled-wheel/*.whl build/compiled

test-compiled: compiled ## run the tests with compiled modules; tells how many these refuse, and why
	PYTHONSAFEPATH=1 PYTHONPATH=$(CURDIR)/build/compiled $(BIN)/pytest -p tests.compiled.left_out $(WORKERS)

test-all: ## run the tests with each Python that piezod supports (some ten minutes each)
	@.ci/test-all $(WORKERS)

# Other numba, other machine code: it must not take turns with that of .venv.
test-lowest: build/lowest/.installed ## run the tests with the oldest versions that pyproject.toml allows
	NUMBA_CACHE_DIR=$(CURDIR)/build/lowest/kernels build/lowest/bin/python -m pytest $(WORKERS) -W ignore::DeprecationWarning

coverage: $(STAMP) ## run the tests and tell which lines they leave out (twice as long)
	$(BIN)/python -m pytest --cov $(WORKERS)

stress: $(STAMP) ## run the tests that take longer
	PIEZOD_EXAMPLES=long $(BIN)/python -m pytest -m "stress or hypothesis" --timeout 1800

faults: $(STAMP) ## run the proofs of all faults, and compare their times with the promises
	$(BIN)/python -m tests.faults $(WORKERS)

export-code: $(STAMP) ## compile exported code with each compiler here, run it, and compare a million steps (minutes)
	$(BIN)/python -m pytest -rs -m "stress or not stress" --timeout 1800 tests/inverse/test_exported_code.py

chaos: $(STAMP) ## kill, starve and flood the processes of a stage (some minutes)
	$(BIN)/python -m pytest -rs -m chaos --timeout 600 tests/chaos tests/liars

liars: $(STAMP) ## let an amplifier lie in each way, in each state, and judge each write (half an hour)
	$(BIN)/python -m tests.liars --out build/liars

soak: $(STAMP) ## run a stage for HOURS=24 in virtual time, with faults (RATE=20, SEED=, MODEL=stops)
	$(BIN)/python -m tests.soak --hours $(HOURS) $(if $(RATE),--rate $(RATE)) $(if $(SEED),--seed $(SEED)) \
		$(if $(MODEL),--model $(MODEL)) --out build/soak

firmware: ## compile the firmware of the player board, print its sizes, test and analyse its core
	$(MAKE) --no-print-directory -s -C firmware/player all test analyse

board: $(STAMP) ## run everything about the player board through its compiled firmware (half an hour)
	$(BIN)/python -m pytest -rs -m "stress or not stress" --timeout 3600 tests/drivers/serial_line/test_board_*.py \
		tests/drivers/test_player_contract.py tests/drivers/bus tests/system -k "board"

vm: $(STAMP) ## install the wheel in a virtual Debian with systemd, and check the service there (CHECKS=comedi: only those)
	$(BIN)/python -m tests.vm $(CHECKS)

mutants: $(STAMP) build/mutants/.installed ## change what stops a stage, place by place; each change must fail a test
	build/mutants/bin/python -m tests.mutants $(MODULES)

peers: $(STAMP) build/peers/.installed ## run programs by others against drivers and emulators
	$(BIN)/python -m pytest -rs -m peers tests/peers

bluesky: $(STAMP) build/bluesky/.installed ## scan simulated stages with Bluesky's RunEngine
	build/bluesky/bin/python -m mypy --cache-dir build/bluesky/mypy piezod/bluesky tests/bluesky
	build/bluesky/bin/python -m pytest -rs -m bluesky tests/bluesky --timeout 600

epics: $(STAMP) build/epics/.installed ## run the IOC and EPICS clients by others against it
	$(BIN)/python -m pytest -rs -m epics tests/epics

pymodaq: $(STAMP) build/pymodaq/.installed ## move a simulated stage with the example plug-in of PyMoDAQ
	$(BIN)/python -m pytest -rs -m pymodaq tests/pymodaq

pymmcore: $(STAMP) build/pymmcore/.installed ## acquire a z-stack with the example device of pymmcore-plus
	$(BIN)/python -m pytest -rs -m pymmcore tests/pymmcore

qudi: $(STAMP) build/qudi/.installed ## move a simulated stage with the example module of qudi
	$(BIN)/python -m pytest -rs -m qudi tests/qudi

docs: $(STAMP) build/docs-env/.installed ## build the documentation as a site
	NO_MKDOCS_2_WARNING=1 build/docs-env/bin/python -m mkdocs --quiet build --strict --config-file docs/site/mkdocs.yml
	@echo "Site: build/docs/index.html. With search: $(BIN)/python -m http.server --directory build/docs"

docs-test: $(STAMP) build/docs-env/.installed ## run the long commands of the documentation, its notebook and its site
	$(BIN)/python -m pytest -rs -m docs tests/docs

browser: $(STAMP) build/browser/.installed ## use the page in a browser, as people do (needs chromium)
	build/browser/bin/python -m pytest -rs -m browser tests/browser

screenshots: $(STAMP) build/browser/.installed ## make the pictures of the page anew (needs chromium)
	build/browser/bin/python -m tests.browser.screenshots

fuzz: $(STAMP) build/fuzz/.installed ## feed what a fuzzer makes up to every reader and driver (20 s each)
	build/fuzz/bin/python -m tests.fuzz $(TARGETS)

schemathesis: $(STAMP) build/schemathesis/.installed ## send a simulated stage what its description allows, and more (1 min)
	$(BIN)/python -m tests.openapi

# The tests come last, so that their verdict is the last line.
check: lint audit $(STAMP) ## run everything that continuous integration runs
	.ci/check-package
	$(MAKE) --no-print-directory test

lint: $(STAMP) ## check style, types and import directions
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

audit: $(STAMP) build/audit/.installed ## look for known vulnerabilities and other licences in the dependencies
	$(BIN)/python -m tests.supply.audit

wheel: $(STAMP) build/audit/.installed ## build sdist, wheel and the parts list of the wheel in dist/
	$(BIN)/python -m build --no-isolation .
	$(BIN)/python -m tests.supply.sbom dist

release: $(STAMP) build/audit/.installed ## build and check what is released; tags and uploads nothing
	$(BIN)/python -m tests.supply.release

bench: $(STAMP) ## measure what a sample, a start and a recording cost
	@for file in benchmarks/bench_*.py; do $(BIN)/python "$$file" || exit; done

bench-peers: $(STAMP) build/bench-peers/.installed ## compare models by others and plain controllers with ours (half an hour)
	$(BIN)/python -m benchmarks.peers
	$(BIN)/python -m benchmarks.peers.controllers

figures: $(STAMP) ## make the figures of the documentation anew (some minutes)
	$(BIN)/python -m docs.figures

lock: ## pin the newest versions of all dependencies (needs uv)
	@.ci/lock

clean: ## remove .venv, builds and caches
	rm -rf .venv build dist .coverage .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

$(STAMP): requirements.lock pyproject.toml .ci/setup .ci/environment.sh
	@.ci/setup
	@echo "piezod: compiling the kernels and the tests"
	@$(BIN)/python -m pytest --collect-only --quiet >/dev/null & $(BIN)/python -m tests.kernels && wait
	@touch $@

build/lowest/.installed: pyproject.toml
build/%/.installed: .ci/tools/%.txt .ci/setup-tool .ci/environment.sh | $(STAMP)
	@.ci/setup-tool $*
	@touch $@
