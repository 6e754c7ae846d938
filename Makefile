# Every target works from a bare clone with Python 3.11 or newer, its venv module and make.
PYTHON ?= python3
PORT ?= 8000
DATA ?= var
VENV := .venv
BIN := $(VENV)/bin
DENO := $(BIN)/deno

export FRONTRUNNER_PORT := $(PORT)
export FRONTRUNNER_VAR := $(abspath $(DATA))

.PHONY: install run serve test test-slow test-all check docs wheel kernels bench bench-slam bench-pareto bench-crowd bench-device_map lock clean

install: $(VENV)/.installed

$(VENV)/bin/pip:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(None if v >= (3, 11) else f"Frontrunner needs Python 3.11 or newer, {sys.executable} is {v[0]}.{v[1]}: run make PYTHON=python3.11")'
	@$(PYTHON) -m venv $(VENV) || { echo "Could not create $(VENV): Python needs its venv module (on Debian and Ubuntu, the package python3-venv)"; rm -rf $(VENV); exit 1; }

$(VENV)/.installed: requirements.lock | $(VENV)/bin/pip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	@touch $@

$(VENV)/.installed-development: requirements-development.lock $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-development.lock
	@touch $@

$(VENV)/.installed-kernels: requirements-kernels.lock $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-kernels.lock
	@touch $@

run: $(VENV)/.installed
	@$(BIN)/python manage.py serve --measure

serve: $(VENV)/.installed
	@$(BIN)/python manage.py serve

# Processes of tests share the cores: BLAS's threads would only wait for each other.
test test-slow test-all: export OPENBLAS_NUM_THREADS := 1
# The tests start hundreds of programs: without bytecode each would compile all modules first.
test test-slow test-all: export PYTHONDONTWRITEBYTECODE :=
test: $(VENV)/.installed-development
	$(BIN)/python -m pytest -n 2 -m "not slow and not exhaustive"

# Servers, databases, browsers, and whatever takes long. Two of three processes mostly wait for them.
# A part of it: make test-slow ONLY=tests/browser
test-slow: $(VENV)/.installed-development
	$(BIN)/python -m pytest -n 3 -m "slow and not exhaustive" $(ONLY)

# Every cell of every grid, an emulated ARM machine among them: before a release.
test-all: $(VENV)/.installed-development
	$(BIN)/python -m pytest -n 3 $(ONLY)

check: export DENO_NO_UPDATE_CHECK := 1
check: $(VENV)/.installed-development
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(DENO) lint --quiet --rules-exclude=no-window,no-window-prefix,require-await client_kit/web crowd/dashboard/static/dashboard docs/_static
	$(DENO) check --quiet --config client_kit/web/jsconfig.json $(filter-out %/service-worker.js,$(wildcard client_kit/web/*.js))
	$(DENO) check --quiet --config client_kit/web/jsconfig.service-worker.json client_kit/web/service-worker.js
	$(BIN)/python manage.py makemigrations --check --dry-run
	$(BIN)/python manage.py check --deploy --fail-level WARNING
	@report=$$($(BIN)/pip-audit --disable-pip --require-hashes --progress-spinner off -r requirements.lock 2>&1) || \
	    case "$$report" in *"known vulnerabilit"*) echo "$$report"; exit 1;; esac; \
	case "$$report" in \
	    *"could not be audited"* | *Error*) echo "Dependency audit: no index answers";; \
	    *) echo "Dependency audit: nothing known";; \
	esac

# The guide, which a server shows at /guide/. Nothing is downloaded; a broken link is an error.
docs: $(VENV)/.installed-development
	rm -rf frontrunner/guide
	$(BIN)/python -m sphinx --nitpicky --fail-on-warning --keep-going --quiet --doctree-dir build/doctrees docs frontrunner/guide

wheel: docs
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

# The OpenCL kernels as WebAssembly, and their golden vectors. Run it after a change of a kernel or of a plan's state.
kernels: $(VENV)/.installed-kernels
	$(BIN)/python -m slam.kfusion.module
	$(BIN)/python -m slam.kfusion.vectors

bench: bench-slam bench-pareto bench-crowd bench-device_map

bench-slam bench-pareto bench-crowd bench-device_map: bench-%: $(VENV)/.installed-development
	$(BIN)/python -m tests.benchmarks.$* $(ARGS)

# Addresses of package indexes stay out of the locks; the hashes decide what is installed.
LOCK := uv pip compile --universal --python-version 3.11 --generate-hashes --no-header --no-emit-index-url --quiet
lock:
	$(LOCK) pyproject.toml --extra server --output-file requirements.lock
	$(LOCK) pyproject.toml --extra server --extra monitoring --constraints requirements.lock --output-file requirements-monitoring.lock
	$(LOCK) pyproject.toml --extra server --extra s3 --constraints requirements.lock --output-file requirements-s3.lock
	$(LOCK) pyproject.toml --extra server --extra development --constraints requirements.lock --output-file requirements-development.lock
	$(LOCK) --group kernels --output-file requirements-kernels.lock

clean:
	rm -rf $(VENV) build dist frontrunner/guide *.egg-info .pytest_cache .mypy_cache .ruff_cache
