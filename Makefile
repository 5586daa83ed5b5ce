# A machine needs Python 3.11 or newer and make; git is not required. `make demo` and `make test` do the rest.

# Run each candidate: a shim named python3.11 may exist without the interpreter behind it.
PYTHON ?= $(shell for candidate in python3.11 python3; do \
	$$candidate -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$candidate && break; done)
BIN := .venv/bin
INSTALLED := .venv/.installed
INSTALLED_DOCS := .venv/.installed-docs
# pip leaves the modules to be compiled when they are first imported: each once, and only those that are used. Where
# Python is told to keep no bytecode, every process would compile them again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all coverage test-oldest docs notebooks bench bench-check bench-peers format hooks \
	release-check dist release clean

demo: $(INSTALLED)
	$(BIN)/jaxmodel demo --out demo-results

# Cheapest first. Each pytest worker compiles for itself, so a file stays with one worker and compiles once, and files
# keep their order: those of few tests, put last, would be the longest. Beside two workers, threads of BLAS would only
# wait for a core.
test: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyrefly check --summary=none
	$(BIN)/pyrefly check --summary=none --config pyrefly-public.toml
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder $(TESTS)

# The tests marked as slow too: before a release, and after a change of what they test.
test-all:
	$(MAKE) test TESTS=--all

# Lines and branches of the library that the fast tests run, the least covered modules first. Shown, with no bound: a
# bound asks for tests that run lines, not for tests that can fail. What runs in a kernel or under jit is traced once.
coverage: $(INSTALLED)
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder --cov --cov-report=term $(TESTS)

# The fast tests with the oldest releases that pyproject.toml allows, in an environment apart: before a release. Old
# releases call what newer ones deprecate; that is no error of ours.
test-oldest:
	@test -x .venv-oldest/bin/pip || $(PYTHON) -m venv .venv-oldest
	$(PYTHON) tests/oldest.py > .venv-oldest/constraints.txt
	.venv-oldest/bin/pip install --quiet --no-compile --constraint .venv-oldest/constraints.txt --editable '.[test]'
	OPENBLAS_NUM_THREADS=1 .venv-oldest/bin/pytest -n 2 --dist loadfile --no-loadscope-reorder \
		-W default::DeprecationWarning -W default::PendingDeprecationWarning

# Strict: a link that leads nowhere, or a page that would fetch anything from another host, fails the build.
docs: $(INSTALLED_DOCS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "Open site/index.html"

# The outputs that the site shows are saved with the notebooks: run them again where code or API has changed.
notebooks: $(INSTALLED_DOCS)
	$(BIN)/jupyter nbconvert --to notebook --execute --inplace docs/tutorials/*.ipynb

bench: $(INSTALLED) bench-peers
	$(BIN)/python -m benchmarks

# Two minutes: ratios to peers, held against the last ones in benchmarks/history.csv; fails if one has become larger.
bench-check: $(INSTALLED)
	$(BIN)/python -m benchmarks check

# What the benchmark compares with: the extra peers, beside the rest. Without it they are left out.
bench-peers: $(INSTALLED)
	@$(BIN)/pip install --quiet --no-compile --constraint constraints.txt --editable '.[test,peers]' \
		|| echo "The peers could not be installed; the benchmark leaves them out."

format: $(INSTALLED)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# From then on git checks each commit and its message, as .pre-commit-config.yaml says.
hooks: $(INSTALLED)
	$(BIN)/prek install

# Before the hours of a release: what would end it.
release-check:
	@echo '$(VERSION)' | grep -qxE '[0-9]+\.[0-9]+\.[0-9]+' || { echo "Name the version: make release VERSION=1.2.3"; exit 1; }
	@test -z "$$(git status --porcelain)" || { echo "Commit or remove what git status lists."; exit 1; }
	@grep -qF '## [$(VERSION)]' CHANGELOG.md || { echo "CHANGELOG.md has no section [$(VERSION)]."; exit 1; }
	@test -z "$$(git tag --list 'v$(VERSION)')" || { echo "The tag v$(VERSION) is there already."; exit 1; }

# With VERSION, the files of that release before there is its tag, so that a tag is only put on what could be built.
dist: $(INSTALLED)
	rm -rf dist
	SETUPTOOLS_SCM_PRETEND_VERSION=$(VERSION) $(BIN)/uv build --quiet
	$(BIN)/twine check --strict dist/*

release: release-check
	$(MAKE) test-all
	$(MAKE) test-oldest
	$(MAKE) dist
	git tag --annotate --message 'jaxmodel $(VERSION)' v$(VERSION)

# A stamp: the install runs once, and again when what it installs changes.
$(INSTALLED): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "No Python 3.11 or newer found; install one, or name it: make PYTHON=/path/to/python"; exit 1; }
	@test -x $(BIN)/pip || $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --constraint constraints.txt --upgrade pip  # as old as Python 3.11, it takes twice as long
	$(BIN)/pip install --quiet --no-compile --constraint constraints.txt --editable '.[test]'
	@touch $@

$(INSTALLED_DOCS): $(INSTALLED)
	$(BIN)/pip install --quiet --no-compile --constraint constraints.txt --editable '.[docs]'
	@touch $@

clean:
	rm -rf .venv .venv-oldest .jax-cache workbench-pictures .hypothesis .coverage .pytest_cache .ruff_cache build dist site demo-results *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
