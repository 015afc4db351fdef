# make sample · make test · make test-full · make mutants · make docs · make lint · make bench     (each sets up .venv by itself; needs Python 3.11 or newer)
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do $$p -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
OUT ?= out/sample
IMAGE ?= examples/images/oven.png

.PHONY: sample test test-full mutants docs try-docs lint format bench clean

.venv/ready: requirements.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "make: needs Python 3.11 or newer with venv on the PATH (or: make PYTHON=/path/to/python)"; exit 2; }
	@echo "· setting up .venv with $(PYTHON) (once; about a minute)"
	@$(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch .venv/ready

sample: .venv/ready
	@echo "· $(IMAGE) -> $(OUT) with the shipped model"
	@$(BIN)/python sample.py $(IMAGE) --out $(OUT) --overwrite

# byte-code is kept, for the next run and for what tests start, also where the shell says otherwise
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest
# a process a core, four at most (1.5 GB each); a module's tests stay together, in conftest's order
SPREAD := -n auto --maxprocesses 4 --dist loadscope --no-loadscope-reorder

test: .venv/ready
	@echo "· the fast suite (CPU, no network); make test-full runs everything"
	@$(PYTEST) $(SPREAD)

test-full: .venv/ready
	@echo "· the whole suite; what a missing program would cover is skipped with the command that installs it"
	@JAX_DISABLE_MOST_OPTIMIZATIONS=0 $(PYTEST) $(SPREAD) -m "" -rs

mutants: .venv/ready
	@echo "· lines broken on purpose, one at a time, in a copy; each must fail the test that is named for it"
	@$(BIN)/python tools/mutants.py

docs: .venv/ready
	@$(BIN)/python -c "import mkdocs, material, mkdocstrings" 2>/dev/null || { echo "· installing MkDocs"; $(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[docs]"; }
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet && echo "· out/site/index.html"

try-docs: .venv/ready
	@echo "· commands and Python of README, quickstart and tutorial, in a copy, with their seconds"
	@$(BIN)/python tools/try_docs.py

lint: .venv/ready
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/pyright

format: .venv/ready
	@$(BIN)/ruff check --fix . && $(BIN)/ruff format .

# the peer is PyTorch on a CPU; nothing else needs it. TORCH=torch takes the default build
TORCH ?= torch --index-url https://download.pytorch.org/whl/cpu
bench: .venv/ready
	@$(BIN)/python -c "import torch" 2>/dev/null || { echo "· installing PyTorch, the peer"; $(BIN)/python -m pip install --quiet --disable-pip-version-check $(TORCH); }
	@for script in joint_code_noise networks voxelize prepare attention full_size training_step; do echo "· benchmarks/$$script.py"; $(BIN)/python benchmarks/$$script.py || exit 1; done

clean:
	rm -rf .venv out
