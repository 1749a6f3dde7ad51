# Every target first puts what it needs into .venv. PYTHON chooses the interpreter, 3.11 or later.
PYTHON ?= python3
BIN := .venv/bin

# Many processes start for a test: without bytecode each would compile every module again.
unexport PYTHONDONTWRITEBYTECODE

# The versions that development and CI use; `make LOCK=` takes the newest that pyproject.toml allows.
LOCK ?= requirements.lock
# Modules are compiled when they are first imported: pip would compile all of the packages, one after the other.
INSTALL = -m pip install --quiet --disable-pip-version-check --no-compile $(if $(LOCK),--constraint $(LOCK))
# Ours are built with the setuptools of .venv: an environment for each of the builds would take longer than the builds.
INSTALL_OURS = $(INSTALL) --no-build-isolation $$($(BIN)/python tests/shared/distributions.py $(1))
PYPROJECTS := pyproject.toml $(wildcard extensions/*/pyproject.toml)

# The last commit of 0.1.0.
BASE ?= 9693e5e

.PHONY: run test test-all check check-types check-style bench bench-agents bench-gas bench-wind bench-edits bench-robots bench-methods bench-suite bench-against bench-setup bench-peers bench-table bench-nightly crossings plume-statistics reality soak soak-faults soak-restarts soak-travel soak-network attacks freeze freeze-check one-digest capabilities golden docs docs-site docs-serve readability dist contract setup lock version bench-training simulated-entries raced-entries

run: .venv/ready .venv/compiled   # fly the quickstart
	$(BIN)/gslcosim up scenarios/warehouse_empty.yaml

# Needs pip and nothing else: what needs packages of Debian, or Python packages of many megabytes, is for test-all.
LIGHT := not soak and not debian and not extras
ifdef EXTENSION
test: .venv/ready-dev-$(EXTENSION)  # the tests of one extension, with what it needs: EXTENSION=bench
	$(BIN)/pytest -q -n 2 --dist loadscope --no-loadscope-reorder -m "(tour or not slow and not end_to_end) and $(LIGHT)" extensions/$(EXTENSION)/tests
else
test: .venv/ready-dev       # what a newcomer types: the fast tests, and each capability once; EXTENSION=NAME for those of one
	$(BIN)/pytest -q -n 2 -m "not slow and not end_to_end and $(LIGHT)"
	$(BIN)/pytest -q -n 2 --dist loadscope --no-loadscope-reorder -m "tour and $(LIGHT)"
endif

LEFT_OUT := not soak and (debian or extras or (not tour and (slow or end_to_end)))
test-all: .venv/ready-test-all  # all that `make test` leaves out; what is missing for a test is listed at the end
	@tests/install_debian_packages.sh
	@$(BIN)/gslcosim cache compile  # so that no test waits for a compilation
	$(BIN)/pytest -q -n 2 -rs --dist loadscope --no-loadscope-reorder -m "not end_to_end and $(LEFT_OUT)"
	$(BIN)/pytest -q -n 4 -rs --dist loadscope --no-loadscope-reorder -m "end_to_end and $(LEFT_OUT)"  # they wait for much of their time

check: .venv/ready-check      # style, types, layers, spelling, imports that are not declared; types beside the rest
	@$(MAKE) --no-print-directory --jobs 2 check-types check-style
check-types: .venv/ready-check
	$(BIN)/pyright
check-style: .venv/ready-check
	$(BIN)/ruff check && $(BIN)/ruff format --check && $(BIN)/codespell
	$(BIN)/lint-imports --no-logo && $(BIN)/deptry .
	@set -e; for folder in $(dir $(wildcard extensions/*/pyproject.toml)); do (cd $$folder && ../../$(BIN)/deptry .); done

bench: .venv/ready-test-all      # how fast it is on this machine
	@set -e; for script in $(filter-out %/bench_edits.py %/bench_against.py %/bench_setup.py %/bench_peers.py %/bench_robot_peers.py,$(wildcard tests/benchmarks/bench_*.py)); do echo "== $$script"; $(BIN)/python $$script; done

bench-agents: .venv/ready-test-all  # decisions per second and round trip, for each language and door
	$(BIN)/python tests/benchmarks/bench_agents.py

bench-against: .venv/ready-test-all  # today's speed beside another commit's, in turns; BASE=COMMIT, by default 0.1.0
	$(BIN)/python tests/benchmarks/bench_against.py --base $(BASE)

bench-setup:                     # time and disk of a fresh set-up beside another commit's, in turns; BASE=COMMIT, by default 0.1.0
	$(PYTHON) tests/benchmarks/bench_setup.py $(BASE)

bench-table: .venv/ready-test-all .venv-peers/ready  # the rows of speed that matter most beside their goals, in a few minutes; ALL=--all for all
	$(BIN)/python tests/benchmarks/speed_table.py --base $(BASE) $(ALL)

bench-nightly: .venv/ready-test-all .venv-peers/ready  # all rows, kept in tests/benchmarks/speed_history.jsonl, and compared with the last ten there
	$(BIN)/python tests/benchmarks/speed_table.py --base $(BASE) --all --save --compare

bench-peers: .venv/ready-dev .venv-peers/robots  # ticks per second beside HELICS and mosaik, robots beside simulators of them, in turns
	$(BIN)/python tests/benchmarks/bench_peers.py
	$(BIN)/python tests/benchmarks/bench_robot_peers.py

bench-gas: .venv/ready-test-all  # how fast the gas is, beside its targets
	$(BIN)/python tests/benchmarks/bench_gas.py

bench-suite: .venv/ready-test-all  # what a flight of a suite costs and its parts, how busy workers are, whether memory stays flat
	$(BIN)/python tests/benchmarks/bench_suite.py $(SUITE)

simulated-entries: .venv/ready-dev  # how often ranks and intervals of simulated suites err, beside binomial bands
	$(BIN)/python tests/benchmarks/simulated_entries.py

raced-entries: .venv/ready-dev  # places of left-out entries from 15 % of their runs, recorded and simulated
	$(BIN)/python tests/benchmarks/raced_entries.py

bench-training: .venv/ready-test-all  # agent steps per second in batches, beside single environments, in turns; how far batched rotorcraft are from full flights
	$(BIN)/python tests/benchmarks/bench_training.py
	$(BIN)/python docs/studies/first_order_flight.py

bench-wind: .venv/ready-test-all  # how accurate and fast the wind solver is; QUICK=--quick for less
	$(BIN)/python tests/benchmarks/bench_wind.py $(QUICK)

bench-edits: .venv/ready-test-all  # how near edited winds are to full solves, and what they cost; QUICK=--quick for less
	$(BIN)/python tests/benchmarks/bench_edits.py $(QUICK)

bench-robots: .venv/ready-test-all  # how fast vehicles fly and drive, beside targets, and how accurately
	$(BIN)/python tests/benchmarks/bench_robots.py
	$(BIN)/python tests/benchmarks/bench_onboard.py
	$(BIN)/python docs/studies/robot_accuracy.py

bench-methods: .venv/ready-test-all  # what a decision of each method costs, beside its limit and plain numpy; SAVE=--save for docs/methods.md
	$(BIN)/python tests/benchmarks/bench_methods.py $(SAVE)

crossings: .venv/ready-test-all  # rooms crossed from nine starts by a scripted agent; ROOMS=folders of GSL-Bench environments
	$(BIN)/python docs/studies/crossings.py $(ROOMS)

plume-statistics: .venv/ready-test-all   # table and plots of intermittency and peaks along a plume, and through a MOX sensor
	$(BIN)/python docs/studies/plume_statistics.py --plot plume_statistics.png

# DATA=FOLDER of measured data; ONLY='CASE …' for some of the cases; QUICK=--quick for less.
DATA ?= ../shared/reference/measured
reality: .venv/ready-dev     # our physics beside measurements: the table, docs/studies/reality.md, errors of runs
	$(BIN)/gslcosim reality --data $(DATA) --out docs/studies $(addprefix --only ,$(ONLY)) $(QUICK)
	cp docs/studies/reality/expected_errors.json extensions/validation/gslcosim_validation

soak: .venv/ready-test-all       # many seeds and hours of simulated time
	@tests/install_debian_packages.sh
	$(BIN)/pytest -q -m soak --timeout 3600
	$(BIN)/python tests/soak/network_campaign.py

# Ten seconds a trial; JOBS at a time.
N ?= 1000
JOBS ?= 2
soak-faults: .venv/ready-test-all  # random faults of every member in every phase, and a table of what came of them; N=TRIALS
	$(BIN)/python tests/soak/fault_campaign.py --trials $(N) --jobs $(JOBS)

soak-network: .venv/ready-test-all  # one run over links with delay, loss and cuts, as root: its table of speeds and digests
	@tests/install_debian_packages.sh
	$(BIN)/python tests/soak/network_campaign.py

soak-restarts: .venv/ready-test-all  # services killed at random ticks, and a table of what came of them; N=TRIALS
	$(BIN)/python tests/soak/restart_campaign.py --trials $(N)

soak-travel: .venv/ready-test-all  # random runs replayed, gone on with at snapshots, forked, and a table of what came of them; N=TRIALS of each
	$(BIN)/python tests/soak/travel_campaign.py --trials $(N)

attacks: .venv/ready-test-all    # what agents that try to cheat reach in each sandbox
	$(BIN)/pytest -q -m soak tests/end_to_end/test_sandboxes.py tests/end_to_end/test_socket_attacks.py

# ONLY=PATTERNS for a part of it; FROZEN=FILE in place of tests/freeze/frozen.json.
FREEZE = $(BIN)/python tests/freeze/freeze.py $(1) $(if $(ONLY),--only $(ONLY)) $(if $(FROZEN),--frozen $(FROZEN))
freeze: .venv/ready-test-all     # write results that must not change, to the bit; an interrupted one goes on; review the diff
	$(call FREEZE,write)

freeze-check: .venv/ready-test-all  # compute them and name what differs; a quarter of an hour
	$(call FREEZE,check)

one-digest: .venv/ready-test-all  # digests of the bundled scenarios on several kinds of processor; OPTIONS as --help says
	$(BIN)/python tests/freeze/one_digest.py $(OPTIONS)

capabilities: .venv/ready-test-all  # what commands, names, keys and messages differ from another commit's; BASE=COMMIT, NAMED=FILE
	$(BIN)/python tests/freeze/capabilities.py compare $(BASE) $(if $(NAMED),--named $(NAMED))

golden: .venv/ready-dev     # rewrite the golden files; review the diff
	GSLCOSIM_REWRITE_GOLDEN=1 $(BIN)/pytest -q tests/golden

docs: .venv/ready-dev contract    # rewrite the generated pages
	$(BIN)/python docs/_build/messages_page.py > docs/messages.md
	$(BIN)/python docs/_build/scenario_page.py > docs/scenario.md
	$(BIN)/python docs/_build/sensors_page.py docs/sensors.md
	$(BIN)/python docs/_build/methods_page.py agents docs
	$(BIN)/python docs/_build/search_page.py docs

docs-site: .venv/ready-docs  # build the pages as a site in build/site; what is wrong with a page is an error
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -c docs . build/site
	@echo "Built build/site/index.html"

docs-serve: docs-site        # show the site at http://127.0.0.1:8000
	$(BIN)/python -m http.server --bind 127.0.0.1 --directory build/site 8000

readability: .venv/ready    # words, long and passive sentences of each page, at BASE=COMMIT and now
	@$(BIN)/python docs/_build/readability.py $(BASE)

dist: .venv/ready-check      # build source packages and wheels of core and extensions in dist, and check what an index would refuse
	rm -rf dist
	$(BIN)/python docs/_build/kernel_archives.py
	@set -e; for folder in $(dir $(PYPROJECTS)); do $(BIN)/python -m build --no-isolation --outdir dist $$folder; done
	$(BIN)/twine check --strict dist/*

version:                     # write V=VERSION in core, extensions and citation
	sed -i -E 's/^(__version__ = ).*/\1"$(V)"/' gslcosim/__init__.py
	sed -i -E 's/^(version: ).*/\1$(V)/' CITATION.cff
	sed -i -E 's/^(version = ).*/\1"$(V)"/; s/(gslcosim[a-z-]*(\[[a-z,]*\])?==)[^"]*/\1$(V)/' extensions/*/pyproject.toml

contract: .venv/ready-dev   # rewrite the published contract; review the diff
	rm -rf agents/contract
	$(BIN)/python docs/_build/contract_hash.py
	$(BIN)/python docs/_build/contract_files.py agents/contract
	$(BIN)/python docs/_build/file_schemas.py
	$(BIN)/python docs/_build/extensions_table.py

setup: .venv/ready-check .venv/ready-test-all  # everything for development, with compiled kernels
	$(BIN)/gslcosim cache compile

# Each distribution with all that `make` installs, as uv reads it.
LOCKED = for folder in $(patsubst %/,%,$(dir $(PYPROJECTS))); do echo "$$folder[dev,check,test-all]"; done
lock: .venv/ready           # write requirements.lock anew: the newest versions that all pyproject.toml allow; review the diff
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	@$(LOCKED) | $(BIN)/uv pip compile - --universal --upgrade --python-version 3.11 --no-emit-index-url --no-annotate --no-header \
		--quiet $(patsubst extensions/%/pyproject.toml,--no-emit-package gslcosim-%,$(filter extensions/%,$(PYPROJECTS))) \
		--no-emit-package gslcosim --output-file requirements.lock

.venv/ready: $(PYPROJECTS) setup.py $(LOCK)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "gslcosim needs Python 3.11 or later: make PYTHON=python3.11")'
	@echo "Setting up .venv (once, about half a minute)"
	@$(PYTHON) -m venv .venv && $(BIN)/python $(INSTALL) 'setuptools>=77'
	@$(BIN)/python $(INSTALL) --no-build-isolation --editable . && touch $@

# The kernels of the quickstart, in the cache of the user; of changed code they are compiled when it first runs.
.venv/compiled: .venv/ready
	@$(BIN)/gslcosim cache compile warehouse_empty && touch $@

# The core and all extensions with their extras dev, docs, check and test-all.
.venv/ready-dev .venv/ready-docs .venv/ready-check .venv/ready-test-all: .venv/ready-%: .venv/ready
	@echo "Installing all extensions with the extra $* into .venv (once)"
	@$(BIN)/python $(call INSTALL_OURS,--extra $*) && touch $@

.venv/ready-dev-%: .venv/ready
	@echo "Installing the extension $* into .venv (once)"
	@$(BIN)/python $(call INSTALL_OURS,--extra dev $*) && touch $@

# Nothing of ours: what the extra names, and no more.
PEERS = import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["$(1)"], sep="\n")
# Some peers need a newer Python than ours.
PEERS_PYTHON ?= $(PYTHON)
.venv-peers/ready: pyproject.toml
	@echo "Setting up .venv-peers (once)"
	@$(PEERS_PYTHON) -m venv .venv-peers
	@$(PYTHON) -c '$(call PEERS,peers)' > .venv-peers/peers.txt
	@.venv-peers/bin/python -m pip install --quiet --disable-pip-version-check -r .venv-peers/peers.txt && touch $@

# As far as they can be installed.
.venv-peers/robots: .venv-peers/ready
	@for peer in $$($(PYTHON) -c '$(call PEERS,robot-peers)'); do \
		.venv-peers/bin/python -m pip install --quiet --disable-pip-version-check $$peer \
		|| echo "$$peer cannot be installed here; make bench-peers leaves it out."; done
	@touch $@
