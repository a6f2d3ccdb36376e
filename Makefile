# Two commands do all on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
export PYTHONDONTWRITEBYTECODE =  # tests start many commands, which import a compiled credit as a user's do

.PHONY: demo test test-thorough test-slow test-processors golden docs lint format wheel clean

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[test]' -c constraints.txt
	touch $(STAMP)

# The main job: the paper's Table 1, 20 seeds of every method, in the terminal, as figures and in MLflow.
demo: $(STAMP)
	$(BIN)/credit train -m experiment=advertiser method=block,delayed,reference,adaptive_mse,disagreement seed=0 replicas=20
	$(BIN)/credit compare experiment=advertiser

test: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist loadfile

# What takes a second or two each, or is one more of a kind.
test-thorough: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "thorough and not slow"

# The numerical tests again under every other instruction set that this processor has.
test-processors: $(STAMP)
	$(BIN)/python tests/processors.py

test-slow: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "slow or thorough or not slow"

# Short runs of every method, by the code before the redesign and by this: the same to the bit?
golden: $(STAMP)
	$(BIN)/python tests/golden/compare.py

# The pages, into site/, without a network: open site/index.html.
docs: $(STAMP)
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
