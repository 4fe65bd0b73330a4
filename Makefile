# Two commands for a fresh machine with Python 3.11 or newer:
#   make demo   makes .venv, installs Pomona, runs the main job on the bundled sample
#   make test   makes .venv-dev, installs what the tests need, runs the quick tests
# Others: make check (what .ci/run runs), make docs (the documentation as a site: site/index.html), make viewer (rebuild the
# viewer; needs Node), make fuzz (damaged files by every reader, for hours), make nightly (slow tests, fuzzing and
# benchmarks; a table of their figures over revisions).

PYTHON ?= python3
DEMO_OUT ?= pomona-demo

.PHONY: demo test check lint docs slow nightly fuzz viewer clean

demo: .venv/installed
	.venv/bin/pomona demo --out $(DEMO_OUT)

# A process for each core, as long as there is memory for them; the tests of a file stay together.
PYTEST := .venv-dev/bin/python -m pytest -n logical --maxprocesses 4 --dist loadfile

test: .venv-dev/installed
	$(PYTEST)

check: lint test docs slow

lint: .venv-dev/installed
	.venv-dev/bin/ruff check .
	.venv-dev/bin/ruff format --check .
	.venv-dev/bin/mypy
	.venv-dev/bin/mypy --platform win32

docs: .venv-dev/installed
	.venv-dev/bin/python docs/assemble.py build/docs
	.venv-dev/bin/zensical build --strict --clean

slow: .venv-dev/installed
	$(PYTEST) -m slow --durations 15

nightly: .venv-dev/installed
	.ci/nightly

FUZZ_FILES ?= 10000
fuzz: .venv-dev/installed
	mkdir -p build
	cd tests && ../.venv-dev/bin/python -m fuzz --files $(FUZZ_FILES) --out ../build/fuzz.md

viewer:
	cd viewer && npm ci && npm run build && npm test

.venv/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Pomona needs Python 3.11 or newer; call make with PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --quiet --upgrade pip
	.venv/bin/python -m pip install --quiet --editable .
	touch $@

.venv-dev/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Pomona needs Python 3.11 or newer; call make with PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv .venv-dev
	.venv-dev/bin/python -m pip install --quiet --upgrade pip
	.venv-dev/bin/python -m pip install --quiet --editable '.[dev,docs,train,synth]'
	touch $@

clean:
	rm -rf .venv .venv-dev build dist site
