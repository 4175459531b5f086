# Every target sets itself up: a virtual environment in .venv, pinned packages, and
# system libraries where root or password-less sudo allows.

PYTHON ?= python3
BIN := .venv/bin
comma := ,
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Images of containers set this, and no command would keep the bytecode of what it imports: with torch, two seconds
# each time.
unexport PYTHONDONTWRITEBYTECODE
# The first is read when packages are installed, the second when they are built.
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_BUILD_CONSTRAINT := $(CURDIR)/constraints.txt

.PHONY: demo demo-video measure twin weights weights-first weights-sets weights-elsewhere gains paper paper-tables features test check lint format bench fuzz endurance setup developer docs \
  figures

# The whole loop on simulated people it has never seen; with DMAE_DATA set, on the Shelf recording as well.
DEMO := runs/demo
demo: setup
	$(BIN)/dmae demo size=full out=$(DEMO) $(if $(DMAE_DATA),shelf=$(DMAE_DATA)/shelf)

# From pixels alone: rendered cameras with truth, beside the simulated detector on the same clip; and with DMAE_DATA set,
# real videos of four cameras.
VIDEO := runs/demo_video
PIXELS := methods=[measured,dmae] skeleton=body25 smooth=0
demo-video: setup
	$(BIN)/synth generate out=$(VIDEO)/clips seed=7 clips=1 scene.seconds=3 scene.persons=[2,2] rig=ring rig.ring.views=4 \
	  images=rgb quality=draft workers=2
	$(BIN)/dmae run clip=$(VIDEO)/clips/000000 out=$(VIDEO)/rendered workers=2
	$(BIN)/dmae evaluate data=$(VIDEO)/rendered/detected $(PIXELS) out=$(VIDEO)/scores_pixels
	$(BIN)/dmae evaluate data=$(VIDEO)/clips/000000 $(PIXELS) out=$(VIDEO)/scores_simulated
ifdef DMAE_DATA
	$(BIN)/dmae run videos=$(DMAE_DATA)/pose2sim/videos calibration=$(DMAE_DATA)/pose2sim/S00_Calibration \
	  out=$(VIDEO)/real workers=2
endif
	$(BIN)/dmae report clip=$(VIDEO)/rendered/completed scores=[$(VIDEO)/scores_pixels,$(VIDEO)/scores_simulated] \
	  out=$(VIDEO)/report.html
	@echo "Look at $(VIDEO)/report.html$(if $(DMAE_DATA), and $(VIDEO)/real/report.html)"

# The Shelf recording's digital twin, beside the recording: do detections fail alike, does capture do as well?
TWIN := runs/twin
twin: setup
	@test -n "$(DMAE_DATA)" || { echo "error: make twin DMAE_DATA=<the folder that holds shelf/>"; exit 1; }
	$(BIN)/synth generate scene=shelf_twin out=$(TWIN) seed=1 workers=2
	$(BIN)/dmae evaluate data=$(TWIN) methods=[linear] views=[5,4,3] out=$(TWIN)_scores
	$(BIN)/dmae evaluate data=shelf data.path=$(DMAE_DATA)/shelf methods=[linear] views=[5,4,3] out=$(TWIN)_shelf_scores
	$(BIN)/synth compare real=$(DMAE_DATA)/shelf sim=$(TWIN) workers=2 out=$(TWIN)_compare

# The weights that come with the package, for BODY_25, in two stages. The first learns from people made up and a few CMU takes, in rooms
# with Shelf's cameras and with others; it stops after 36 minutes. The second continues from it on more subjects, rigs and detectors, for
# 10,000 steps; what comes of it is in $(WEIGHTS)/model. Subjects 5, 13 and 86 are in neither: `make gains` scores on them.
WEIGHTS := runs/weights
CAPTURED := $(WEIGHTS)/captured
CMU = $(abspath $(DMAE_DATA))/cmu
GENERATE = $(BIN)/synth generate workers=2
FIRST_TAKES := bvh_cc/002_01 bvh_cc/002_03 bvh_cc/007_01 bvh_cc/007_04 bvh_cc/007_08 bvh_cc/007_12 bvh_daz/martial_04 bvh_daz/martial_07 \
  bvh_daz/salsa_05 bvh_daz/salsa_10 bvh_mb/01_01 bvh_mb/cmu_12_01_walk
FIRST_CALIBRATE := bvh_cc/005_01 bvh_cc/005_03 bvh_cc/005_11 bvh_daz/salsa_20
weights-first: setup
	@test -d "$(CMU)" || { echo "error: make weights DMAE_DATA=<the folder that holds cmu/ and cmu_more/>"; exit 1; }
	mkdir -p $(foreach set,bvh bvh_unseen amc amc_unseen,$(WEIGHTS)/takes/$(set))
	ln -sft $(WEIGHTS)/takes/bvh $(FIRST_TAKES:%=$(CMU)/%.bvh)
	ln -sft $(WEIGHTS)/takes/bvh_unseen $(FIRST_CALIBRATE:%=$(CMU)/%.bvh)
	ln -sft $(WEIGHTS)/takes/amc_unseen $(CMU)/asf_amc/49*
	ln -sft $(WEIGHTS)/takes/amc $(CMU)/asf_amc/0*
	$(GENERATE) out=$(WEIGHTS)/made_ring seed=11 clips=96 rig=ring
	$(GENERATE) out=$(WEIGHTS)/made seed=15 clips=96
	$(GENERATE) out=$(WEIGHTS)/cmu seed=12 clips=80 motion=bvh motion.path=$(WEIGHTS)/takes/bvh
	$(GENERATE) out=$(WEIGHTS)/cmu_ring seed=14 clips=112 rig=ring motion=bvh motion.path=$(WEIGHTS)/takes/bvh
	$(GENERATE) out=$(WEIGHTS)/amc_ring seed=13 clips=32 rig=ring motion=amc motion.path=$(WEIGHTS)/takes/amc
	$(GENERATE) out=$(WEIGHTS)/cmu_unseen seed=31 clips=14 motion=bvh motion.path=$(WEIGHTS)/takes/bvh_unseen
	$(GENERATE) out=$(WEIGHTS)/amc_unseen seed=32 clips=10 motion=amc motion.path=$(WEIGHTS)/takes/amc_unseen
	$(GENERATE) out=$(WEIGHTS)/made_unseen seed=33 clips=10 rig=ring
	for set in made_ring made cmu cmu_ring amc_ring cmu_unseen amc_unseen made_unseen; do \
	  $(BIN)/dmae capture data=$(WEIGHTS)/$$set 'draw=[2,3,4,5]' out=$(CAPTURED)/$$set || exit 1; done
	$(BIN)/dmae train data=$(CAPTURED)/made_ring \
	  extra_data=[$(CAPTURED)/made,$(CAPTURED)/cmu,$(CAPTURED)/cmu_ring,$(CAPTURED)/amc_ring] \
	  validation_data=[$(CAPTURED)/cmu_unseen,$(CAPTURED)/amc_unseen,$(CAPTURED)/made_unseen] \
	  max_minutes=36 learning.steps=100000 learning.epoch=500 learning.observed_weight=0.2 out=$(WEIGHTS)/first

# Of each detector: numbers of clips of people made up, of BVH takes and of AMC takes, with rigs in rings and with random ones.
SECOND := hrnet_like,16,16,10 blazepose,16,16,10 posefix,16,16,10 terrible,8,6,4
SECOND_TAKES := bvh_daz/salsa_05 bvh_daz/salsa_10 bvh_daz/salsa_20 bvh_daz/salsa_25 bvh_cc/007_01 bvh_cc/007_04 bvh_cc/007_08 \
  bvh_cc/007_12 bvh_mb/cmu_12_01_walk
MORE = $(abspath $(WEIGHTS))/more
SETS := $(foreach motion,made bvh amc,$(foreach number,1 2 3 4 5 6 7 8,$(motion)_$(number)))
SHELF_SETS := shelf_made shelf_bvh shelf_amc
CALIBRATION := calibrate_bvh calibrate_amc calibrate_shelf calibrate_made
comma := ,
join_sets = $(subst $() ,$(comma),$(foreach set,$(1),$(CAPTURED)/$(set)))
weights-sets: setup
	@test -x "$(DMAE_DATA)/cmu_more/unpack" || { echo "error: make weights DMAE_DATA=<the folder that holds cmu/ and cmu_more/>"; exit 1; }
	$(DMAE_DATA)/cmu_more/unpack $(MORE)/train --set train
	$(DMAE_DATA)/cmu_more/unpack $(MORE)/calibrate --set calibrate
	mkdir -p $(foreach set,bvh amc calibrate_bvh calibrate_amc,$(MORE)/$(set))
	ln -sft $(MORE)/bvh $(MORE)/train/bvh_daz/* $(MORE)/train/bvh_cc/007* $(SECOND_TAKES:%=$(CMU)/%.bvh)
	ln -sft $(MORE)/amc $(MORE)/train/asf_amc/01* $(CMU)/asf_amc/01_01.amc
	ln -sft $(MORE)/calibrate_bvh $(MORE)/calibrate/bvh_daz/*
	ln -sft $(MORE)/calibrate_amc $(MORE)/calibrate/asf_amc/02* $(CMU)/asf_amc/49*
	number=0; for part in $(SECOND); do set -- $$(echo $$part | tr , ' '); for rig in ring random; do \
	  number=$$((number + 1)); drawn="rig=$$rig detector=$$1"; \
	  $(GENERATE) out=$(WEIGHTS)/made_$$number seed=$$((100 + number)) clips=$$2 $$drawn && \
	  $(GENERATE) out=$(WEIGHTS)/bvh_$$number seed=$$((200 + number)) clips=$$3 $$drawn motion=recorded motion.path=$(MORE)/bvh && \
	  $(GENERATE) out=$(WEIGHTS)/amc_$$number seed=$$((300 + number)) clips=$$4 $$drawn motion=recorded motion.path=$(MORE)/amc \
	  || exit 1; done; done
	$(GENERATE) out=$(WEIGHTS)/calibrate_bvh seed=401 clips=12 rig=ring detector=blazepose motion=recorded motion.path=$(MORE)/calibrate_bvh
	$(GENERATE) out=$(WEIGHTS)/calibrate_amc seed=402 clips=10 rig=random detector=hrnet_like motion=recorded motion.path=$(MORE)/calibrate_amc
	$(GENERATE) out=$(WEIGHTS)/calibrate_shelf seed=403 clips=10 motion=recorded motion.path=$(MORE)/calibrate_bvh
	$(GENERATE) out=$(WEIGHTS)/calibrate_made seed=404 clips=10 rig=ring
	$(GENERATE) out=$(WEIGHTS)/shelf_made seed=501 clips=48
	$(GENERATE) out=$(WEIGHTS)/shelf_bvh seed=502 clips=60 motion=recorded motion.path=$(MORE)/bvh
	$(GENERATE) out=$(WEIGHTS)/shelf_amc seed=503 clips=32 motion=recorded motion.path=$(MORE)/amc
	for set in $(SETS) $(SHELF_SETS) $(CALIBRATION); do \
	  $(BIN)/dmae capture data=$(WEIGHTS)/$$set 'draw=[2,3,4,5]' out=$(CAPTURED)/$$set || exit 1; done

TRAIN_SECOND = $(BIN)/dmae train data=$(CAPTURED)/made_1 validation_data=[$(call join_sets,$(CALIBRATION))] learning.epoch=500 \
  learning.observed_weight=0.2
weights: weights-first weights-sets
	$(TRAIN_SECOND) extra_data=[$(call join_sets,$(filter-out made_1,$(SETS)) $(SHELF_SETS))] init=$(WEIGHTS)/first learning.steps=10000 \
	  learning.lr=1e-3 out=$(WEIGHTS)/model
	$(BIN)/dmae evaluate data=shelf data.path=$(DMAE_DATA)/shelf views=[5,4,3] weights=$(WEIGHTS)/model \
	  methods=[linear,dmae,dmae_denoise,dmae_online] out=$(WEIGHTS)/scores_shelf
	$(BIN)/dmae evaluate data=shelf data.path=$(DMAE_DATA)/shelf views=[3] reference=capture smooth=0 \
	  methods=[linear,pchip_body,gaussian_process,dmae] weights=$(WEIGHTS)/model out=$(WEIGHTS)/scores_holes
	$(BIN)/python -c 'import dmae; print(dmae.card("$(WEIGHTS)/model", command="make weights", \
	  scores=["$(WEIGHTS)/scores_holes", "$(WEIGHTS)/scores_shelf"]))' > $(WEIGHTS)/model/MODEL_CARD.md
	@echo "To ship them: cp $(WEIGHTS)/model/{weights.safetensors,model.json,MODEL_CARD.md} dmae/models/body25"

# A model that has seen neither Shelf's cameras nor the detector fitted to its detections: what to expect with other cameras.
weights-elsewhere: weights-sets
	$(TRAIN_SECOND) extra_data=[$(call join_sets,$(filter-out made_1,$(SETS)))] learning.steps=9000 out=$(WEIGHTS)/elsewhere

# What completion gains beside the Gaussian process of one kernel, by length of gap and body part, on subjects that the network did
# not learn from, with three seeds: docs/results/completion_gains.json.
GAINS := runs/gains
GAIN_CLIPS := scene.fps=25 rig=ring scene.persons=[2,2]
gains: setup
	@test -x "$(DMAE_DATA)/cmu_more/unpack" || { echo "error: make gains DMAE_DATA=<the folder that holds cmu_more/>"; exit 1; }
	$(DMAE_DATA)/cmu_more/unpack $(abspath $(GAINS))/takes --set score
	for seed in 41 43 45; do \
	  $(GENERATE) $(GAIN_CLIPS) out=$(GAINS)/clips/amc_$$seed seed=$$seed clips=6 scene.seconds=12 \
	    motion=amc motion.path=$(GAINS)/takes/asf_amc && \
	  $(GENERATE) $(GAIN_CLIPS) out=$(GAINS)/clips/bvh_$$seed seed=$$((seed + 1)) clips=8 scene.seconds=7 \
	    motion=bvh motion.path=$(GAINS)/takes/bvh_cc || exit 1; done
	for set in $(GAINS)/clips/*; do \
	  $(BIN)/dmae capture data=$$set 'draw=[2,3,4,5]' out=$(GAINS)/captured/$$(basename $$set) || exit 1; done
	$(BIN)/python docs/tools/completion_gains.py $(GAINS)/captured/*

# The weights of the paper's network (weights=paper): people who move as recorded or made up, and simulated captures that fusion is learned
# from. Half an hour of simulation and an hour of training on one core; the same command continues. Subjects 2 and 135 validate, 5, 13 and 86
# are scored by `make paper-tables`; the long takes of 13 and 86 are listed six times, as long as the others together.
PAPER := runs/paper
PAPER_PEOPLE := scene.persons=[3,3] scene.seconds=8 rig=ring rig.ring.views=2
ONE_CORE = $(BIN)/synth generate scene.fps=25
paper: setup
	@test -x "$(DMAE_DATA)/cmu_more/unpack" || { echo "error: make paper DMAE_DATA=<the folder that holds cmu/ and cmu_more/>"; exit 1; }
	$(DMAE_DATA)/cmu_more/unpack $(PAPER)/more
	mkdir -p $(foreach set,train validate score,$(PAPER)/takes/$(set))
	ln -sft $(PAPER)/takes/train $(CMU)/asf_amc/01.asf $(CMU)/asf_amc/49* $(abspath $(PAPER))/more/asf_amc/01* $(CMU)/bvh_cc/007_0[14].bvh \
	  $(CMU)/bvh_daz/salsa_* $(abspath $(PAPER))/more/bvh_daz/salsa_* $(CMU)/bvh_mb/*
	ln -sft $(PAPER)/takes/validate $(CMU)/asf_amc/02* $(abspath $(PAPER))/more/asf_amc/02* $(CMU)/bvh_daz/martial_* \
	  $(abspath $(PAPER))/more/bvh_daz/martial_*
	ln -sft $(PAPER)/takes/score $(CMU)/bvh_cc/005_* $(abspath $(PAPER))/more/bvh_cc/005_*
	for number in 1 2 3 4 5 6; do mkdir -p $(PAPER)/takes/score/$$number && \
	  ln -sft $(PAPER)/takes/score/$$number $(abspath $(PAPER))/more/asf_amc/13* $(abspath $(PAPER))/more/asf_amc/86* || exit 1; done
	$(ONE_CORE) out=$(PAPER)/validate seed=62 clips=16 $(PAPER_PEOPLE) motion=recorded motion.path=$(PAPER)/takes/validate
	$(ONE_CORE) out=$(PAPER)/recorded seed=60 clips=320 $(PAPER_PEOPLE) motion=recorded motion.path=$(PAPER)/takes/train
	$(ONE_CORE) out=$(PAPER)/made seed=61 clips=40 $(PAPER_PEOPLE)
	$(BIN)/dmae train model=paper data=$(PAPER)/recorded extra_data=[$(PAPER)/made] validation_data=[$(PAPER)/validate] \
	  out=$(PAPER)/pretrained

# The tables that the paper's network is in: fusion learned on simulated captures, tuned on Shelf in folds; and its codes.
paper-tables: paper
	$(ONE_CORE) out=$(PAPER)/score seed=63 clips=40 $(PAPER_PEOPLE) motion=recorded motion.path=$(PAPER)/takes/score
	$(ONE_CORE) out=$(PAPER)/people seed=52 clips=56 scene.seconds=6 scene.persons=[2,3] motion=recorded motion.path=$(DMAE_DATA)/cmu
	$(BIN)/dmae capture data=$(PAPER)/people 'draw=[3,4,5]' out=$(PAPER)/captured
	for table in 1 2 4; do $(BIN)/dmae table number=$$table data=shelf data.path=$(DMAE_DATA)/shelf \
	  extra_data=[$(PAPER)/captured] out=$(PAPER)/tables || exit 1; done
	$(BIN)/dmae table number=5 data=$(PAPER)/score extra_data=[$(PAPER)/recorded] out=$(PAPER)/tables

# The input features of the default network ablated one by one, in 2,000 steps of training; after `make weights-first`. Errors are in
# $(FEATURES)/*/model.json and in $(FEATURES)_scores; 0 has all features, the others lack those that the sweep names.
FEATURES := runs/features
features: setup
	$(BIN)/dmae train -m data=$(CAPTURED)/made_ring \
	  extra_data=[$(CAPTURED)/made,$(CAPTURED)/cmu,$(CAPTURED)/cmu_ring,$(CAPTURED)/amc_ring] \
	  validation_data=[$(CAPTURED)/cmu_unseen,$(CAPTURED)/amc_unseen,$(CAPTURED)/made_unseen] \
	  learning.steps=2000 learning.epoch=500 learning.observed_weight=0.2 out=$(FEATURES) \
	  'model.ablate=[],[gap],[ray],[held],[bone_length],[jitter],[bone_stretch],[held,bone_length,jitter,bone_stretch]'
	grep hidden_ $(FEATURES)/*/model.json
	for number in 0 1 2 3 4 5 6 7; do for input in true_poses perturbed_poses; do \
	  $(BIN)/dmae evaluate data=$(WEIGHTS)/cmu_unseen input=$$input smooth=0 methods=[dmae] weights=$(FEATURES)/$$number \
	  out=$(FEATURES)_scores/$$number/$$input || exit 1; done; done

# What measures methods, at its small size: the paper's tables, the benchmark, stress, a gate. Under 15 minutes on two cores.
# The full sizes are size=full, for which their pages state the time.
MEASURE := runs/measure
SHELF := data=shelf data.path=$(DMAE_DATA)/shelf
measure: setup
	@test -n "$(DMAE_DATA)" || { echo "error: make measure DMAE_DATA=<the folder that holds shelf/>"; exit 1; }
	$(BIN)/synth generate -m interaction=fight,hug,dance,huddle rig=ring rig.ring.views=3 clips=4 seed=51 workers=2 out=$(MEASURE)/sets
	$(BIN)/dmae table number=1 $(SHELF) out=$(MEASURE)/table_1
	$(BIN)/dmae table number=2 $(SHELF) out=$(MEASURE)/table_2
	$(BIN)/dmae table number=3 size=small data=$(MEASURE)/sets/0 \
	  extra_data=[$(MEASURE)/sets/1,$(MEASURE)/sets/2,$(MEASURE)/sets/3] out=$(MEASURE)/table_3
	$(BIN)/dmae table number=4 size=small $(SHELF) extra_data=[$(MEASURE)/sets/0,$(MEASURE)/sets/1] out=$(MEASURE)/table_4
	$(BIN)/dmae table number=5 size=small data=$(MEASURE)/sets/0 extra_data=[$(MEASURE)/sets/1] out=$(MEASURE)/table_5
	$(BIN)/dmae benchmark size=small workers=2 out=$(MEASURE)/benchmark
	$(BIN)/synth generate clips=2 seed=11 scene.seconds=4 scene.persons=[3,3] workers=2 out=$(MEASURE)/clips
	$(BIN)/dmae stress data=$(MEASURE)/clips workers=2 out=$(MEASURE)/stress
	$(BIN)/dmae evaluate data=$(MEASURE)/clips methods=[linear,dmae] views=[3] out=$(MEASURE)/before
	$(BIN)/dmae evaluate data=$(MEASURE)/clips methods=[linear,dmae] views=[3] baseline=$(MEASURE)/before/scores.json \
	  out=$(MEASURE)/after

# Everything, on all cores: a test file runs in one process, so that its fixtures are made once. Files are given out as
# tests/conftest.py sorts them, not by their number of tests: the longest have few.
PYTEST := $(BIN)/python -m pytest --numprocesses=auto --dist=loadfile --no-loadscope-reorder
test: developer
	$(PYTEST)

# For the person at work: lint and the fast tests, two minutes on two cores.
check: developer lint
	$(PYTEST) -m "not slow" -q

lint: developer
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: developer
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: developer
	$(BIN)/python -m pytest -m bench -s tests/bench

# Changed files for every reader, N each. Ends with the counts, and fails where one does harm.
N ?= 10000
fuzz: developer
	$(BIN)/python -m tests.fuzz.run --count $(N)

# Generation, capture and training killed at 20 random moments each; 500 flipped bits and 60 other damages of a data set
# with images; memory by the number of clips; speed of loaders.
endurance: developer
	$(BIN)/python -m tests.endurance.kills --moments 20
	$(BIN)/python -m tests.endurance.damages --flips 500 --structural 60
	$(BIN)/python -m tests.endurance.memory 100 300 1000
	$(BIN)/python -m tests.endurance.long_recording 100000
	$(BIN)/python -m tests.endurance.loaders

# The documentation site, in site/. A warning, a stale tutorial or a figure that differs from its file fails it.
docs: developer
	$(BIN)/python docs/tools/pages.py --check
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Measure anew what takes minutes, and execute the tutorials that changed. What takes longer: make twin, make weights
# (36 minutes of training).
figures: developer
	@test -n "$(DMAE_DATA)" || { echo "error: make figures DMAE_DATA=<the folder that holds shelf/ and pose2sim/>"; exit 1; }
	$(BIN)/python docs/tools/record.py
	$(BIN)/python docs/tools/tutorials.py
	$(BIN)/python docs/tools/pages.py

# Python compiles what it imports, a part of what is installed: half of the time of an installation.
INSTALL := $(BIN)/pip install --no-compile

setup: .venv/installed
developer: .venv/developed

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
	@echo "installing the package and what it needs into .venv: some 60 packages, 2 GB, most of it torch"
	$(INSTALL) -e .
	@touch $@

# What tests, lint and documentation need beyond the package itself. Of mjlab and pose2sim only the models are used, of a
# robot and for OpenSim: the programs need a graphics card and a desktop.
.venv/developed: .venv/installed
	@{ command -v chromium || command -v chromium-browser || command -v google-chrome; } >/dev/null || { $(call apt,chromium); } || \
	  echo "note: no Chromium, and no right to install one: the tests that open the report in a browser are skipped"
	@echo "installing what tests and documentation need into .venv: some 100 packages more"
	$(INSTALL) -e '.[dev]'
	$(INSTALL) --no-deps mjlab pose2sim
	@touch $@
