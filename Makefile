PYTHON ?= python

.PHONY: format check test docs bench

format:
	$(PYTHON) -m ruff check --fix
	$(PYTHON) -m ruff format

check:
	$(PYTHON) -m ruff check
	$(PYTHON) -m ruff format --check
	$(PYTHON) -m mypy

test:
	$(PYTHON) -m pytest -n auto --dist loadfile

docs:
	$(PYTHON) -m sphinx -W -n -b html docs docs/_build/html

bench:
	$(PYTHON) -m benchmarks.speed
