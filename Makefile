# make dataset   set everything up and build the home-alarm dataset from gait models
# make test      set everything up and run every check
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: dataset test benchmark clean

dataset: $(VENV)/.installed
	$(BIN)/doppelgait dataset build home-alarm -o home-alarm

test: $(VENV)/.installed-test
	$(BIN)/ruff check src tests benchmarks studies
	$(BIN)/ruff format --check src tests benchmarks studies
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n auto

benchmark: $(VENV)/.installed
	$(BIN)/python benchmarks/chain.py

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else f"doppelgait needs Python 3.11 or newer, $(PYTHON) is {v.major}.{v.minor}; set PYTHON=python3.12 or the like")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.installed-test: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable ".[test]"
	touch $@

clean:
	rm -rf $(VENV) home-alarm demo build dist
