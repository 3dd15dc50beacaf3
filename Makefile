# Two commands do everything, each with its own set-up: `make demo` and `make test`.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: demo test nightly lint bench clean

demo: $(INSTALLED)
	$(BIN)/python examples/demo.py

# A file's tests stay together in one process: they share what is slow to make.
test: lint
	$(BIN)/pytest --numprocesses auto --dist loadfile

# A million random trials of each kernel, machine code against the c3x build; an hour's flights of both mechanisations.
nightly: $(INSTALLED)
	FIRMWARE_SIM_TRIALS=1000000 $(BIN)/pytest tests/nav/test_machine_code.py
	FIRMWARE_SIM_FLIGHT_S=3600 $(BIN)/pytest tests/nav/test_mechanisations.py

lint: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(INSTALLED)
	$(BIN)/python -m tests.benchmarks

clean:
	rm -rf $(VENV) demo-output

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[dev]"
	touch $@
