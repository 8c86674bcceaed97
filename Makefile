PYTHON ?= python

.PHONY: format check pages test docs bench

format:
	$(PYTHON) -m ruff check --fix
	$(PYTHON) -m ruff format

check:
	$(PYTHON) -m ruff check
	$(PYTHON) -m ruff format --check
	$(PYTHON) -m mypy

pages:
	npm install --silent
	npx biome ci

test:
	$(PYTHON) -m pytest -n auto --dist loadfile

docs:
	npm install --silent
	$(PYTHON) -m sphinx -W -n -b html docs docs/_build/html

bench:
	$(PYTHON) -m benchmarks.speed
