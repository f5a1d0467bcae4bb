# Everything on a fresh machine: `make run` calibrates the shipped campaign, `make test` passes the tests.
# Packages are those of requirements/, checked by their hashes; `make lock` takes the newest of today.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUTPUT ?= output
PIP := -m pip --quiet --disable-pip-version-check
LOCKED := --require-hashes --only-binary :all: --requirement
LOCK := uv pip compile --quiet --universal --no-build --python-version 3.11 --generate-hashes --no-header --no-annotate

.PHONY: run quick test test-lowest test-long lock parts audit fuzz test-browser test-bridges docs wheel bench bench-jobs bench-long coverage first-look plank-drops faults constants check-faults check-numbers damages kills failing-calls mutations soak fleets independent made-trucks changes lint format clean

run: $(VENV)/.installed
	$(BIN)/python calibrate.py run data/campaign.toml --output $(OUTPUT)

quick: $(VENV)/.installed
	$(BIN)/python calibrate.py run data/campaign.toml --output $(OUTPUT) --quick

test: lint test-lowest
	$(BIN)/python -m pytest -n 2 --dist loadfile

test-long: $(VENV)/.dev
	$(BIN)/python -m pytest -m long

# An hour for every reader, two at a time: contents that are guided by the code that they reach. Thirteen hours of one core.
fuzz: $(VENV)/.dev
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[fuzz]"
	$(BIN)/python -m studies.fuzz --output build/fuzz --document docs/evidence/robustness.md

# The report in headless Chromium: accessibility (axe-core), console, network, interaction. Needs node and chromium.
test-browser: $(VENV)/.dev
	cd tests/report/browser && npm install --silent --no-audit --no-fund
	$(BIN)/python -m pytest -m browser tests/report tests/watch

# The examples for other bridge programs, installed for this alone. OpenSees needs libblas3 and liblapack3 of the system.
test-bridges: $(VENV)/.dev
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[bridges]"
	$(BIN)/python -m pytest -m bridges tests/export

# The documentation as a site in build/site; warnings are errors.
docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# A wheel with the native engine inside, tried in an environment without a compiler: some ten minutes.
wheel: $(VENV)/.dev
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[wheel]"
	$(BIN)/python -m tools.build_wheel --output build/wheel
	$(BIN)/python -m tools.check_wheel build/wheel

# Other solvers beside ours: they are installed for this alone.
bench: $(VENV)/.dev
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[bench]"
	$(BIN)/python -m benchmarks --output build/benchmarks --document docs/evidence/benchmarks.md
	$(BIN)/python -m benchmarks.flops --output build/benchmarks --document docs/evidence/benchmarks.md

# Whole jobs, cold and warm, in an environment with the program alone; then samplers on the fit of one of them.
bench-jobs: $(VENV)/.dev
	$(PYTHON) -m venv build/benchmarks/plain
	build/benchmarks/plain/bin/pip install --quiet --disable-pip-version-check --editable .
	$(BIN)/python -m benchmarks.jobs --python build/benchmarks/plain/bin/python --only reference --cold --document docs/evidence/benchmarks.md
	$(BIN)/python -m benchmarks.jobs --python build/benchmarks/plain/bin/python --only reference truck "three axles" --document docs/evidence/benchmarks.md
	$(BIN)/python -m benchmarks.samplers --fit build/benchmarks/jobs/out-truck --document docs/evidence/benchmarks.md

# Twenty runs of a minute at 1 kHz.
bench-long: $(VENV)/.dev
	$(BIN)/python -m benchmarks.jobs --only long --document docs/evidence/benchmarks.md

# Hours on one core; can be stopped and goes on with what is missing.
coverage: $(VENV)/.dev
	$(BIN)/python -m studies.coverage --output build/coverage --document docs/evidence/statistics.md

# Some ten minutes on one core: drops with viscous, dry and quadratic damping.
plank-drops: $(VENV)/.dev
	$(BIN)/python -m studies.plank_drops --seed 81120263 --output build/plank_drops --document docs/drops.md

# Some twenty minutes on one core: what `init` guesses right, marks and leaves to a person.
first-look: $(VENV)/.dev
	$(BIN)/python -m studies.first_look --output build/first_look --document docs/howto/init.md

# Three hours on one core: plausible faults through the whole command.
faults: $(VENV)/.dev
	$(BIN)/python -m studies.faults --count 300 --seed 3024 --output build/faults --document docs/evidence/robustness.md

# An hour on one core: damaged, foreign and forged result folders.
damages: $(VENV)/.dev
	$(BIN)/python -m studies.damages --output build/damages --document docs/evidence/robustness.md

# An hour on one core: `run --resume` killed at any moment.
kills: $(VENV)/.dev
	$(BIN)/python -m studies.kills --output build/kills --document docs/evidence/robustness.md

# Hours on one core: calls to the system that fail one after the other. Linux with a C compiler.
failing-calls: $(VENV)/.dev
	$(BIN)/python -m studies.failing_calls --commands export --output build/failing_calls --document docs/evidence/robustness.md

# Hours on one core: changes of the code that a test must see.
mutations: $(VENV)/.dev
	$(BIN)/python $(PIP) install --editable ".[mutation]"
	$(BIN)/python -m studies.mutations --output build/mutations --document docs/evidence/robustness.md

# Ten minutes on one core: memory, handles and threads of many calibrations in one process.
soak: $(VENV)/.dev
	$(BIN)/python -m studies.soak --output build/soak

# Some ten minutes on one core: populations of simulated fleets with known truth.
fleets: $(VENV)/.dev
	$(BIN)/python -m studies.fleets --seed 7411 --output build/fleets --document docs/fleet.md

# Two hours on two quiet cores: trucks of equations of their own through `run`; can be stopped and goes on.
independent: $(VENV)/.dev
	$(BIN)/python -m studies.independent --seed 21383265 --output build/independent --document docs/evidence/statistics.md

# Some six hours on two quiet cores: trucks made from the literature through `run`; can be stopped and goes on.
made-trucks: $(VENV)/.dev
	$(BIN)/python -m studies.made_trucks --all --output build/made_trucks --document docs/evidence/made-trucks.md

# Twenty to forty minutes on one core: pairs of campaigns of one truck, one damper of every second one changed.
changes: $(VENV)/.dev
	$(BIN)/python -m studies.changes --seed 880417 --output build/changes --document docs/howto/compare.md

# Ten minutes on one core: mistakes that `check` must name, and healthy campaigns that it must not accuse.
check-faults: $(VENV)/.dev
	$(BIN)/python -m studies.check_faults --count 144 --seed 9157 --healthy 0 --effects --output build/check_faults --document docs/evidence/check-faults.md
	$(BIN)/python -m studies.check_faults --count 0 --healthy 40 --seed 3391 --output build/check_faults --document docs/evidence/check-faults.md

# Ten minutes on one core: what every constant that moves an interval does to k and c.
constants: $(VENV)/.dev
	$(BIN)/python -m studies.constants examples/linear_truck data --output build/constants --document docs/evidence/constants.md

# Half an hour on one core: every declared number times a factor.
check-numbers: $(VENV)/.dev
	$(BIN)/python -m studies.check_faults.numbers --part kept --output build/check_faults --document docs/evidence/check-faults.md

lint: $(VENV)/.dev
	$(BIN)/python -m tools.audit requirements/run.txt requirements/dev.txt requirements/lowest.txt
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# The program and all formats of logs.
$(VENV)/.installed: pyproject.toml requirements/run.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python $(PIP) install $(LOCKED) requirements/run.txt
	$(BIN)/python $(PIP) install --no-deps --no-build-isolation --editable .
	touch $@

# What tests, checks and documentation need too.
$(VENV)/.dev: $(VENV)/.installed requirements/dev.txt
	$(BIN)/python $(PIP) install $(LOCKED) requirements/dev.txt
	touch $@

build/lowest/.installed: pyproject.toml requirements/lowest.txt
	$(PYTHON) -m venv build/lowest
	build/lowest/bin/python $(PIP) install $(LOCKED) requirements/lowest.txt
	build/lowest/bin/python $(PIP) install --no-deps --no-build-isolation --editable .
	touch $@

# The newest versions that pyproject.toml allows, and the oldest.
lock: $(VENV)/.dev
	$(BIN)/python $(PIP) install --editable ".[supply]"
	$(BIN)/$(LOCK) --upgrade pyproject.toml --extra run --output-file requirements/run.txt
	$(BIN)/$(LOCK) --upgrade pyproject.toml --extra dev --constraint requirements/run.txt --output-file requirements/dev.txt
	$(BIN)/$(LOCK) --upgrade pyproject.toml --extra test --resolution lowest-direct --output-file requirements/lowest.txt

# Parts (CycloneDX) and licences of what `make run` installs; a wheel carries both lists.
parts: $(VENV)/.dev
	$(BIN)/python $(PIP) install --editable ".[supply]"
	$(PYTHON) -m venv --clear --without-pip build/parts
	$(BIN)/python -m pip --python build/parts/bin/python --quiet install $(LOCKED) requirements/run.txt
	$(BIN)/cyclonedx-py environment --output-reproducible --pyproject pyproject.toml --output-file requirements/parts.cdx.json build/parts/bin/python
	$(BIN)/python -m tools.plain_parts requirements/parts.cdx.json
	$(BIN)/pip-licenses --python build/parts/bin/python --format markdown --output-file requirements/licences.md

# Known weaknesses of these parts, asked on the package index: needs the network. What was known when the list in
# requirements/ was looked through, `make lint` finds without one.
audit: $(VENV)/.dev
	$(BIN)/python $(PIP) install --editable ".[supply]"
	$(BIN)/pip-audit --strict --disable-pip --require-hashes --requirement requirements/run.txt

# The oldest versions that pyproject.toml allows: some minutes. Of their warnings about newer packages none is ours.
test-lowest: build/lowest/.installed
	build/lowest/bin/python -m pytest -q -W default tests/cli/test_quick_run.py tests/cli/test_options.py tests/export

clean:
	rm -rf $(VENV) build output .pytest_cache .mypy_cache .ruff_cache
