# make dataset   set everything up and build the home-alarm dataset from gait models
# make check     set everything up, lint, type-check and run the tests in this process, 90 s on two processors
# make test      the same, and the tests of processes, built datasets, training and the browser, as continuous integration does, 5 minutes
# make release   every test, also those marked `release`: site, examples of the pages, kills, clusters, wheel, studies, as every night; then known vulnerabilities of dependencies (AUDIT=skip leaves them out)
# make fuzz      damage files for everything that reads them, CASES=100000 of them, and print a table; MEANWHILE=1: whole files that change while they are read; make release has a short run
# make docs      build the documentation site into docs/_build/html, warnings are errors
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PACKAGES := --editable packages/liland2018 --editable packages/conformance
BUILT_FROM := pyproject.toml hatch_build.py $(wildcard packages/*/pyproject.toml native/*)

.PHONY: dataset fuzz check lint test release audit docs docs-links benchmark clean

dataset: $(VENV)/.installed
	$(BIN)/doppelgait dataset build home-alarm -o home-alarm

lint: $(VENV)/.installed-test
	$(BIN)/ruff check src packages tests benchmarks studies tools docs
	$(BIN)/ruff format --check src packages tests benchmarks studies tools docs
	$(BIN)/clang-format --dry-run -Werror native/*.cpp native/*.hpp
	$(BIN)/mypy
	$(BIN)/lint-imports

# Whole files to a worker, the longest first (tests/conftest.py): what a file's tests share is made once. Compiled
# Python is kept even where the environment says otherwise: the suite starts hundreds of processes. Linting runs beside
# the tests; what it says comes at the end.
define PYTEST
@said=$$(mktemp); $(MAKE) --no-print-directory lint >"$$said" 2>&1 & lint=$$!; tests=0; linted=0; \
trap 'kill $$lint 2>/dev/null; rm -f "$$said"' EXIT; trap 'exit 130' INT TERM; \
PYTHONDONTWRITEBYTECODE= $(BIN)/pytest -n auto --dist loadfile --no-loadscope-reorder $(1) || tests=$$?; \
wait $$lint || linted=$$?; cat "$$said"; \
if [ $$linted -ne 0 ]; then echo "lint failed, see above" >&2; fi; [ $$tests -eq 0 ] && [ $$linted -eq 0 ]
endef

check: $(VENV)/.installed-test
	$(call PYTEST,-m "not release" --ignore tests/system --ignore tests/browser --ignore tests/fuzz)

test: $(VENV)/.installed-test
	$(call PYTEST,-m "not release")

release: $(VENV)/.installed-test
	$(call PYTEST,)
	@$(MAKE) --no-print-directory audit

# A known vulnerability of an installed package fails, and so does a check that cannot run, unless AUDIT=skip; without
# a network, that it was not checked is one line.
audit: $(VENV)/.installed-test
	@if [ "$(AUDIT)" = skip ]; then echo "audit: skipped"; exit 0; fi; \
	said=$$($(BIN)/python -m pip_audit --skip-editable --progress-spinner off --timeout 15 2>&1) && echo "audit: $$(echo "$$said" | head -n 1)," \
	"$$(echo "$$said" | grep -c "could not be audited") packages could not be checked" \
	|| case "$$said" in \
	*known\ vulnerabilit*) echo "$$said" >&2; exit 1 ;; \
	*ConnectionError*|*ConnectTimeout*|*Max\ retries*|*onnection\ to*|*timed\ out*|*NameResolution*|*ProxyError*) \
		echo "audit: known vulnerabilities were not checked, there is no network: $$(echo "$$said" | tail -n 1)" ;; \
	*) echo "$$said" >&2; echo "audit: known vulnerabilities cannot be checked; AUDIT=skip leaves this out" >&2; exit 1 ;; esac

CASES ?= 100000
SEED ?= 0
fuzz: $(VENV)/.installed-test
	@OMP_NUM_THREADS=1 $(BIN)/python tests/fuzz/fuzz.py --cases $(CASES) --seed $(SEED) $(if $(MEANWHILE),--meanwhile)

docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	$(BIN)/python docs/check_links.py docs/_build/html
	@echo "documentation: docs/_build/html/index.html"

docs-links: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -q -b linkcheck docs docs/_build/links

benchmark: $(VENV)/.installed
	$(BIN)/python benchmarks/chain.py

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else f"doppelgait needs Python 3.11 or newer, $(PYTHON) is {v.major}.{v.minor}; set PYTHON=python3.12 or the like")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BUILT_FROM) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[viewer]" $(PACKAGES)
	touch $@

$(VENV)/.installed-test: $(BUILT_FROM) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[test]" $(PACKAGES)
	touch $(VENV)/.installed $@

$(VENV)/.installed-docs: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable ".[docs]"
	touch $@

clean:
	rm -rf $(VENV) home-alarm demo build dist docs/_build docs/auto_gallery docs/reference
