# Two commands do all on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt
RUNS := .venv/.runs
DOCS := .venv/.docs
STAMP := .venv/.installed
export PYTHONDONTWRITEBYTECODE =  # tests start many commands, which import a compiled credit as a user's do

.PHONY: demo test test-thorough test-slow test-processors golden docs lint format wheel clean

# Credit alone, with what builds its pages, and with all that its tests need: each is a part of the last.
$(RUNS): pyproject.toml constraints.txt
	@echo "setting up .venv: credit and what it runs on"
	$(PYTHON) -m venv .venv
	$(PIP) -e .
	touch $@

$(DOCS): $(RUNS)
	@echo "setting up .venv: what builds the pages"
	$(PIP) -e '.[docs]'
	touch $@

$(STAMP): pyproject.toml constraints.txt
	@echo "setting up .venv: credit and all that its tests need"
	$(PYTHON) -m venv .venv
	$(PIP) -e '.[test]'
	touch $(RUNS) $(DOCS) $@

# The main job: the paper's Table 1, 20 seeds of every method, in the terminal, as figures and in MLflow.
demo: $(RUNS)
	$(BIN)/credit train -m experiment=advertiser method=block,delayed,reference,adaptive_mse,disagreement seed=0 replicas=20
	$(BIN)/credit compare experiment=advertiser

test: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist loadfile

# What takes a second or two each, or is one more of a kind.
test-thorough: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "thorough and not slow"

# The numerical tests of `make test` again under every other instruction set that this processor has.
test-processors: $(STAMP)
	$(BIN)/python tests/processors.py

test-slow: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "slow or thorough or not slow"

# Short runs of every method, by the code before the redesign and by this: the same to the bit?
golden: $(STAMP)
	$(BIN)/python tests/golden/compare.py

# The pages, into site/, without a network: open site/index.html.
docs: $(DOCS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

wheel: $(STAMP)
	$(BIN)/python -m build --wheel --outdir dist .

clean:
	rm -rf .venv dist build site .pytest_cache .mypy_cache .ruff_cache
