# The two commands of the README. Everything they need is installed into .venv from requirements.lock; only Python >= 3.11 must be there.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test check bench clean

run: $(VENV)/ready ## the main job on the embedded virtual rig: 40 s in real time
	$(BIN)/spsp-ctrl run --config config/rig.yaml

test: $(VENV)/ready ## lint, types, all tests
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not realtime and not sequences and not matrix"
	$(BIN)/python -m pytest -m realtime

bench: $(VENV)/ready ## wall-time figures, printed as ratios; never part of the tests
	$(BIN)/python -m tools.bench

$(VENV)/ready: pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed, this is " + sys.version)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock --editable .
	touch $@

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
