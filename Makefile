# Every target sets itself up: a virtual environment in .venv, pinned packages, and
# system libraries where root or password-less sudo allows.

PYTHON ?= python3
BIN := .venv/bin
comma := ,
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# The first is read when packages are installed, the second when they are built.
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_BUILD_CONSTRAINT := $(CURDIR)/constraints.txt

.PHONY: demo twin test lint format bench setup

# The whole loop on simulated people it has never seen; with DMAE_DATA set, on the Shelf recording as well.
DEMO := runs/demo
demo: setup
	$(BIN)/synth generate out=$(DEMO)/train seed=1 clips=40 workers=2
	$(BIN)/dmae capture data=$(DEMO)/train out=$(DEMO)/train_captured
	$(BIN)/synth generate out=$(DEMO)/test seed=2 clips=2 workers=2 scene.seconds=4 images=rgb quality=draft
	$(BIN)/dmae train data=$(DEMO)/train_captured out=$(DEMO)/model max_minutes=1.5
	$(BIN)/dmae capture data=$(DEMO)/test out=$(DEMO)/captured
	$(BIN)/dmae complete clip=$(DEMO)/captured weights=$(DEMO)/model out=$(DEMO)/completed
	$(BIN)/dmae evaluate data=$(DEMO)/test methods=[measured,linear,dmae] weights=$(DEMO)/model out=$(DEMO)/scores
ifdef DMAE_DATA
	$(BIN)/dmae evaluate data=shelf data.path=$(DMAE_DATA)/shelf views=[5,3] methods=[measured,linear,dmae] \
	  weights=$(DEMO)/model out=$(DEMO)/scores_shelf
endif
	$(BIN)/dmae report clip=$(DEMO)/completed scores=[$(DEMO)/scores$(if $(DMAE_DATA),$(comma)$(DEMO)/scores_shelf)] \
	  out=$(DEMO)/report.html
	@echo "Look at $(DEMO)/report.html"

# The Shelf recording's digital twin, beside the recording: do detections fail alike, does capture do as well?
TWIN := runs/twin
twin: setup
	$(BIN)/synth generate scene=shelf_twin out=$(TWIN) seed=1 workers=2
	$(BIN)/dmae evaluate data=$(TWIN) methods=[linear] views=[5,4,3] out=$(TWIN)_scores
	$(BIN)/dmae evaluate data=shelf data.path=$(DMAE_DATA)/shelf methods=[linear] views=[5,4,3] out=$(TWIN)_shelf_scores
	$(BIN)/synth compare real=$(DMAE_DATA)/shelf sim=$(TWIN) workers=2 out=$(TWIN)_compare

test: setup
	$(BIN)/python -m pytest

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: setup
	$(BIN)/python -m pytest -m bench -s tests/bench

setup: .venv/installed

# $(call apt,packages): install Debian packages, or fail where that is not allowed.
define apt
command -v apt-get >/dev/null && \
if [ "$$(id -u)" = 0 ]; then as=; else sudo -n true 2>/dev/null && as="sudo -n"; fi && \
$$as apt-get -qq update && \
DEBIAN_FRONTEND=noninteractive $$as apt-get -qq install -y --no-install-recommends $(1) >/dev/null
endef

.venv/installed: pyproject.toml constraints.txt Makefile
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: needs Python 3.11 or later, found $$($(PYTHON) -V 2>&1); name another: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { $(call apt,$(notdir $(PYTHON))-venv); } || \
	  { echo "error: $(PYTHON) cannot make virtual environments; install $(notdir $(PYTHON))-venv"; exit 1; }
	@$(PYTHON) -c 'import ctypes; ctypes.CDLL("libOSMesa.so.8")' 2>/dev/null || \
	  { ls /usr/share/glvnd/egl_vendor.d/*.json && $(PYTHON) -c 'import ctypes; ctypes.CDLL("libEGL.so.1")'; } >/dev/null 2>&1 || \
	  { $(call apt,libosmesa6 libegl1 libgl1) || { $(call apt,libegl1 libegl-mesa0 libgl1); }; } || \
	  echo "note: no OpenGL library, and no right to install one: images will be ray cast, which is slower"
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet -e '.[dev]'
	@touch $@
