# Everything on a fresh machine: `make run` calibrates the shipped campaign, `make test` passes the tests.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUTPUT ?= output

.PHONY: run quick test test-long fuzz test-browser docs wheel bench bench-jobs bench-long coverage first-look ring-downs faults check-faults check-numbers damages kills soak fleets independent lint format clean

run: $(VENV)/.installed
	$(BIN)/python calibrate.py run data/campaign.toml --output $(OUTPUT)

quick: $(VENV)/.installed
	$(BIN)/python calibrate.py run data/campaign.toml --output $(OUTPUT) --quick

test: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile

test-long: $(VENV)/.installed
	$(BIN)/python -m pytest -m long

# An hour for every reader, two at a time: contents that are guided by the code that they reach. Nine hours of one core.
fuzz: $(VENV)/.installed
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[fuzz]"
	$(BIN)/python -m studies.fuzz --output build/fuzz --document docs/robustness.md

# The report in headless Chromium: accessibility (axe-core), console, network, interaction. Needs node and chromium.
test-browser: $(VENV)/.installed
	cd tests/report/browser && npm install --silent --no-audit --no-fund
	$(BIN)/python -m pytest -m browser tests/report

# The documentation as a site in build/site; warnings are errors.
docs: $(VENV)/.installed
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# A wheel with the native engine inside, tried in an environment without a compiler: some ten minutes.
wheel: $(VENV)/.installed
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[wheel]"
	$(BIN)/python -m tools.build_wheel --output build/wheel
	$(BIN)/python -m tools.check_wheel build/wheel

# Other solvers beside ours: they are installed for this alone.
bench: $(VENV)/.installed
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[bench]"
	$(BIN)/python -m benchmarks --output build/benchmarks --document docs/benchmarks.md
	$(BIN)/python -m benchmarks.flops --output build/benchmarks --document docs/benchmarks.md

# Whole jobs, cold and warm, in an environment with the program alone; then samplers on the fit of one of them.
bench-jobs: $(VENV)/.installed
	$(PYTHON) -m venv build/benchmarks/plain
	build/benchmarks/plain/bin/pip install --quiet --disable-pip-version-check --editable .
	$(BIN)/python -m benchmarks.jobs --python build/benchmarks/plain/bin/python --only reference --cold --document docs/benchmarks.md
	$(BIN)/python -m benchmarks.jobs --python build/benchmarks/plain/bin/python --only reference truck "three axles" --document docs/benchmarks.md
	$(BIN)/python -m benchmarks.samplers --fit build/benchmarks/jobs/out-truck --document docs/benchmarks.md

# Twenty runs of a minute at 1 kHz.
bench-long: $(VENV)/.installed
	$(BIN)/python -m benchmarks.jobs --only long --document docs/benchmarks.md

# Hours on one core; can be stopped and goes on with what is missing.
coverage: $(VENV)/.installed
	$(BIN)/python -m studies.coverage --output build/coverage --document docs/statistics.md

# Some ten minutes on one core: drops with viscous, dry and quadratic damping.
ring-downs: $(VENV)/.installed
	$(BIN)/python -m studies.ring_downs --output build/ring_downs --document docs/drops.md

# Some twenty minutes on one core: what `init` guesses right, marks and leaves to a person.
first-look: $(VENV)/.installed
	$(BIN)/python -m studies.first_look --output build/first_look --document docs/howto/init.md

# Three hours on one core: plausible faults through the whole command.
faults: $(VENV)/.installed
	$(BIN)/python -m studies.faults --count 300 --seed 3024 --output build/faults --document docs/robustness.md

# An hour on one core: damaged, foreign and forged result folders.
damages: $(VENV)/.installed
	$(BIN)/python -m studies.damages --output build/damages --document docs/robustness.md

# An hour on one core: `run --resume` killed at any moment.
kills: $(VENV)/.installed
	$(BIN)/python -m studies.kills --output build/kills --document docs/robustness.md

# Ten minutes on one core: memory, handles and threads of many calibrations in one process.
soak: $(VENV)/.installed
	$(BIN)/python -m studies.soak --output build/soak

# Some ten minutes on one core: populations of simulated fleets with known truth.
fleets: $(VENV)/.installed
	$(BIN)/python -m studies.fleets --seed 7411 --output build/fleets --document docs/fleet.md

# Two hours on two quiet cores: trucks of equations of their own through `run`; can be stopped and goes on.
independent: $(VENV)/.installed
	$(BIN)/python -m studies.independent --seed 21383265 --output build/independent --document docs/statistics.md

# Ten minutes on one core: mistakes that `check` must name, and healthy campaigns that it must not accuse.
check-faults: $(VENV)/.installed
	$(BIN)/python -m studies.check_faults --count 144 --seed 9157 --healthy 0 --effects --output build/check_faults --document docs/check-faults.md
	$(BIN)/python -m studies.check_faults --count 0 --healthy 40 --seed 3391 --output build/check_faults --document docs/check-faults.md

# Half an hour on one core: every declared number times a factor.
check-numbers: $(VENV)/.installed
	$(BIN)/python -m studies.check_faults.numbers --part kept --output build/check_faults --document docs/check-faults.md

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.installed
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@

clean:
	rm -rf $(VENV) build output .pytest_cache .mypy_cache .ruff_cache
