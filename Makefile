# Two commands on a fresh machine with python3 (3.11 or later), make and a C compiler:
#   make all       environment, simulator, the whole study, the paper
#   make test      the same set-up, then the tests of five minutes: parts, effects, readers, a few diagnoses
# and
#   make test-all  the tests that make test leaves out: other instructions, sanitizers, whole runs
#   make lint      format, style and types
#   make proof     every concealed case, hours long, resumable; GRID=glance WORLDS=16 is what make all runs
#   make docs      the pages that are generated from the program
#   make site      the documentation site, in build/site
#   make example   the flights that the package ships, simulated anew
#   make lock      pin what .venv holds
PYTHON ?= python3
CC ?= cc
CORES ?= 2
GRID ?= full
WORLDS ?= 1
METHODS ?= stepwise, parameters, boosting, without-instruments, without-whitening, without-tolerance
UV_VERSION := 0.13.8
EXTRAS := $(addprefix --extra ,study ardupilot betaflight ros ui docs)
VENV := .venv
BIN := $(VENV)/bin
# A process a core, on that core alone: threads that wait for a core which another test has cost as
# much as those that work. Files stay together, so that a fixture of a file is made once, until a
# process has nothing left to do.
PYTEST = OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(CORES) --dist worksteal --durations 40

# Compiled modules are kept: hundreds of processes would each compile them again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: all test test-all proof env build docs site example lint lock clean check-python check-cc
.DEFAULT_GOAL := all

all: build
	@test -n "$$GES_RECORDINGS" || $(BIN)/ges recordings fetch appius-ground-effect --out recordings --timeout 20 \
		|| echo "make: the flights near the ground were not fetched; the study goes on without them"
	$(BIN)/snakemake --cores $(CORES) all

test: build
	$(PYTEST) -m "not slow"

test-all: build
	$(PYTEST) -m slow

proof: build
	$(BIN)/snakemake --cores $(CORES) proof --config 'proof={grid: $(GRID), methods: [$(METHODS)], worlds: {every: $(WORLDS), batches: 20}}'

env: $(VENV)/.locked

build: env check-cc
	@$(MAKE) --no-print-directory -C sim_c CC="$(CC)" -j$(CORES)

docs: build
	$(BIN)/python docs/frames.py
	$(BIN)/python docs/licences.py > docs/licences.md.new && mv docs/licences.md.new docs/licences.md
	$(BIN)/ges effects --markdown > docs/effects.md.new && mv docs/effects.md.new docs/effects.md
	$(BIN)/ges config --markdown > docs/config.md.new && mv docs/config.md.new docs/config.md
	$(BIN)/ges settings --markdown > docs/settings.md.new && mv docs/settings.md.new docs/settings.md
	$(BIN)/ges config --schema > config/schema.json.new && mv config/schema.json.new config/schema.json

site: build
	$(BIN)/mkdocs build --strict

example: build
	$(BIN)/python examples/make_example.py

lint: env
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/mypy

lock:
	$(BIN)/uv pip compile --quiet --universal --generate-hashes --python-version 3.11 --group dev $(EXTRAS) pyproject.toml -o requirements.lock

clean:
	rm -rf build results .snakemake

check-python:
	@command -v $(PYTHON) >/dev/null || { echo "no $(PYTHON) found; install Python 3.11 or later, or call make PYTHON=/path/to/python3" >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "$(PYTHON) is $$($(PYTHON) --version); needed is 3.11 or later, e.g. make PYTHON=python3.12" >&2; exit 2; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "$(PYTHON) lacks venv or pip; on Debian: apt-get install python3-venv" >&2; exit 2; }

check-cc:
	@command -v $(firstword $(CC)) >/dev/null || { echo "no C compiler '$(firstword $(CC))' found; install gcc or clang, or call make CC=/path/to/cc" >&2; exit 2; }

$(VENV)/.locked: requirements.lock pyproject.toml | check-python check-cc
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv==$(UV_VERSION)
	$(BIN)/uv pip sync --quiet --python $(BIN)/python requirements.lock
	$(BIN)/uv pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable .
	touch $@
