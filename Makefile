# Everything sets itself up: `make demo` and `make test` need python3 >= 3.11, git and make.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

.PHONY: install demo test slow bench gate mutants lint docs clean

install: $(READY)

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "slarm-graph needs Python 3.11 or later: make PYTHON=/path/to/python3")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test,docs]'
	-$(BIN)/slarm doctor --compile
	@touch $@

demo: $(READY)
	$(BIN)/slarm demo

test: $(READY)
	$(BIN)/python -m pytest -n auto -p no:benchmark $(PYTEST)

slow: $(READY)
	$(BIN)/python -m pytest -n auto -p no:benchmark -m slow

bench: $(READY)
	$(BIN)/python -m pytest benchmarks --benchmark-only -m ''

gate: $(READY)
	$(BIN)/python benchmarks/gate.py $(RECORDINGS) $(RECORD)

mutants: $(READY)
	$(BIN)/python benchmarks/mutants.py

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy examples/*.py examples/plugins/*/*.py

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

clean:
	rm -rf .venv build dist site *.egg-info
	find . -name '*.nb[ic]' -delete
