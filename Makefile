# Everything a developer or CI does. Needs Python 3.11+, pip and make; `make help` lists the targets.

VENV ?= .venv
BIN := $(VENV)/bin
CORE := $(filter-out %/native.pxd,$(wildcard lidarcli/*/*.pxd lidarcli/*/*/*.pxd))
PYTEST := $(BIN)/pytest -n auto --dist worksteal
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# Bytecode is kept, whatever the surroundings say: tests start many processes, and each worker rewrites all assertions.
export PYTHONDONTWRITEBYTECODE :=
# That of libraries is written for what is imported, when it is: compiling all that is installed takes a minute.
export PIP_COMPILE := no
# As many processes as there are processors.
export MYPY_NUM_WORKERS := auto
# What pip installs, with one line for each module that is compiled; all it says when it fails.
define install
	@mkdir -p build
	@{ $(BIN)/python -m pip --disable-pip-version-check install --verbose --editable $(1) 2>&1; echo "exit $$?"; } \
		| tee build/install.log | awk -v all=$(words $(CORE)) \
		'/^ *building .lidarcli.* extension/ { printf "  compiling the detection, %d of %d\n", ++done, all; fflush() }'
	@tail -n 1 build/install.log | grep -q '^exit 0$$' || { cat build/install.log; exit 1; }
endef
# The first interpreter that is new enough.
PYTHON ?= $(shell for name in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	"$$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo "$$name"; break; }; done)

.DEFAULT_GOAL := help
.PHONY: help demo test test-all check compile quick lint types format samples golden docs site bench bench-full bench-compare same accuracy trees tracking fleet maps overlay reading fuzz bounds clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-13s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(VENV)/compiled ## install, fill demo/ with the logs of the README's first page, show tracks of a log beside the truth
	@mkdir -p demo && ln -sfn ../samples demo/samples
	@cp samples/people.csv.gz demo/people.csv.gz && cp samples/people.zones.toml demo/zones.toml
	@$(BIN)/lidarcli -q simulate samples/monday.toml -o demo/monday.mcap --overwrite
	@$(BIN)/lidarcli -q simulate samples/tuesday.toml -o demo/tuesday.mcap --seed 1 --overwrite
	@$(BIN)/lidarcli -q simulate samples/office.toml -o demo/run.mcap --overwrite
	@$(BIN)/lidarcli -q simulate samples/crooked.toml -o demo/crooked.mcap --overwrite
	@$(BIN)/lidarcli -q map demo/run.mcap -o demo/site.yaml --overwrite
	@$(BIN)/lidarcli -q poses demo/run.mcap -o demo/true.tum --overwrite
	@awk 'NR > 150 && NR <= 260 { $$3 += 0.5 } NR > 360 && NR <= 420 { $$3 -= 2.6 } 1' demo/true.tum > demo/believed.tum
	$(BIN)/lidarcli track samples/people.csv.gz -o demo/tables --overwrite
	@$(BIN)/python -m tools.show_tracks demo/tables/people.tracks.parquet samples/people.truth.parquet
	@echo
	$(BIN)/lidarcli -q report demo/tables/people.objects.parquet --log samples/people.csv.gz -o demo/people.html --overwrite
	@echo
	@echo "Every sweep to look at, in your browser:  $$($(BIN)/python -c 'from pathlib import Path; print(Path("demo/people.html").resolve().as_uri())')"
	@echo "The commands of README.md run in demo/:   . $(BIN)/activate && cd demo"

test: check ## install what the tests need, then check

check: lint types ## lint, format, types and tests
	$(PYTEST) -m "not whole"

test-all: lint types ## the same with all tests, also those that are marked whole (CONTRIBUTING.md lists them)
	$(PYTEST)

compile: $(VENV)/compiled ## the core once more, after a change of its files

quick: lint ## lint, format and the tests that take no time, for between two edits
	$(PYTEST) -q -m "not slow and not whole"

lint: $(VENV)/installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(VENV)/installed-dev
	$(BIN)/mypy

format: $(VENV)/installed-dev ## sort imports and format the code
	$(BIN)/ruff check --select I --fix
	$(BIN)/ruff format

samples: $(VENV)/compiled ## make the sample logs again from their scenes
	PYTHON="$(abspath $(BIN))/python" sh samples/make.sh

golden: $(VENV)/installed-dev ## accept today's tables and reports as the expected ones (then read the diff)
	$(BIN)/python -m tools.golden
	$(BIN)/python -m tools.golden_reports
	git diff --stat -- tests/golden

docs: $(VENV)/compiled ## write docs/cli.md, docs/tables.md and the figures in docs/reports.md from the code, and the outputs of examples
	$(BIN)/python -m tools.make_docs

site: $(VENV)/installed-dev ## the documentation as a site, build/site/index.html; strict about links
	LIDARCLI_COMPILED=no $(BIN)/python -m tools.site build/pages
	LIDARCLI_COMPILED=no $(BIN)/python -m sphinx -W --keep-going -n -q -c docs build/pages build/site
	@echo "For a browser: $(CURDIR)/build/site/index.html"

bench: $(VENV)/compiled ## time and memory of what users wait for, each command beside a reference
	$(BIN)/python benchmarks/bench.py $(BENCH)

bench-full: $(VENV)/installed-dev ## the same with more containers, sensors, profiles, lengths and references
	$(BIN)/python benchmarks/bench.py --all $(BENCH)

bench-compare: $(VENV)/installed-dev ## today's detect against that of another commit, BASE=COMMIT
	$(BIN)/python -m benchmarks.compare $(BASE) $(BENCH)

same: $(VENV)/installed-dev ## whether today's detect finds what that of another commit does, BASE=COMMIT; more logs with LOGS="FOLDER ..."
	$(BIN)/python -m benchmarks.same $(BASE) $(LOGS) $(SAME)

accuracy: $(VENV)/installed-dev ## how right the detection is; writes docs/accuracy.md
	$(BIN)/python -m benchmarks.accuracy $(ACCURACY)

trees: $(VENV)/installed-dev ## grow the trees that tell things from building, from drawn scenes and the recordings in LIDARCLI_REAL_LOGS
	$(BIN)/python -m benchmarks.thing $(TREES)

tracking: $(VENV)/installed-dev ## how well things are followed; writes docs/tracking.md
	$(BIN)/python -m benchmarks.tracking $(TRACKING)

fleet: $(VENV)/installed-dev ## what runs over many logs cost: a store, a cluster, workers that are killed (docs/fleet.md)
	$(BIN)/python -m benchmarks.fleet all $(FLEET)

maps: $(VENV)/installed-dev ## how right maps are; writes docs/maps.md
	$(BIN)/python -m benchmarks.maps $(MAPS)

overlay: $(VENV)/compiled ## how fast overlays are built, beside a type store
	$(BIN)/python -m benchmarks.overlaying $(OVERLAY)

reading: $(VENV)/compiled ## how fast logs of each format become sweeps, beside a script
	$(BIN)/python -m benchmarks.reading $(READING)

fuzz: $(VENV)/installed-dev ## inputs of every kind, mutated or made to harm; more with FUZZ="--seconds 3600"
	$(BIN)/python -m tools.fuzz $(FUZZ)

bounds: $(VENV)/installed-dev ## the core with all indices checked: random batches, samples, real logs
	$(BIN)/python -m tools.bounds

clean: ## remove the environment and everything that was built
	rm -rf $(CORE:.pxd=.*.so) $(VENV) build dist demo .pytest_cache .mypy_cache .ruff_cache .hypothesis

# Stamps of what is done in the environment. The install is editable, so that the code at hand is the code that runs; what
# changed in the core since is compiled in place.
$(VENV)/installed: pyproject.toml setup.py | $(BIN)/python
	@echo "Installing lidarcli into $(VENV) ..."
	$(call install,.)
	@touch $@

$(VENV)/compiled: lidarcli/system/native.pxd lidarcli/formalism/detection.py $(CORE) $(CORE:.pxd=.py) | $(VENV)/installed
	@if [ -n "$$(find $^ -newer $(VENV)/installed)" ]; then echo "Compiling what has changed ..."; \
		$(BIN)/python -m tools.requirements build-system > build/needs.txt && $(PIP) install -r build/needs.txt \
		&& $(BIN)/python setup.py --quiet build_ext --inplace; fi
	@touch $@

$(VENV)/installed-dev: pyproject.toml $(VENV)/compiled
	@echo "Installing what its tests need ..."
	@$(BIN)/python -m tools.requirements dev > build/needs.txt && $(PIP) install -r build/needs.txt
	@touch $@

# Debian leaves ensurepip to the package python3-venv; without it the pip at hand fills the environment.
$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed; name it with make PYTHON=..."; exit 1; }
	@$(PYTHON) -m venv $(VENV) 2>/dev/null \
		|| { $(PYTHON) -m venv --clear --without-pip $(VENV) \
			&& $(PYTHON) -m pip --disable-pip-version-check --quiet --python $(VENV)/bin/python install pip; } \
		|| { rm -rf $(VENV); echo "Cannot create $(VENV): install the package python3-venv, or name an environment that exists with make VENV=..."; exit 1; }
