"""Mistyped commands, options, presets, choices and values are answered with the nearest there is, in one line."""

import pytest

from dmae.cli import DMAE, compose
from dmae.command_line.spelling import checked
from synth.cli import SYNTH
from tests.support.commands import run_command


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    (folder / "file").write_text("")
    (folder / "set").mkdir()
    return folder


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("synth genrate", "no command 'genrate'; did you mean generate?"),
        ("synth generate scen.seconds=3", "scen.seconds: no such option; did you mean scene.seconds?"),
        ("synth generate +scen.seconds=3", "scen.seconds: no such option; did you mean scene.seconds?"),
        ("synth generate ++scen.seconds=3", "scen.seconds: no such option; did you mean scene.seconds?"),
        ("synth generate seconds=3", "seconds: no such option; did you mean scene.seconds?"),
        ("synth generate detector.parts.nos.noise=1", "did you mean detector.parts.nose.noise?"),
        ("synth generate detector.blackouts.share=3", "detector.blackouts.share: no such option; there are"),
        ("dmae generate", "no command 'generate'; there are run, detect"),
        ("dmae generate --help", "demo, regress; synth --help lists others"),
        ("synth generate motion.weights.kick=a", "motion.weights.kick=a: expected a number"),
        ("synth generate motion.weights={kick:a}", "motion.weights.kick=a: expected a number"),
        ("synth generate motion.weights.kik=1", "motion.weights.kik: no such option; did you mean kick? There are"),
        ("synth generate motion.weights=3", "motion.weights=3: expected its entries, as motion.weights."),
        ("dmae stress data=set levels.jitter=a", "levels.jitter=a: expected a list of numbers"),
        ("dmae stress data=set levels.jitter=[1,a]", "levels.jitter=[1,a]: expected a list of numbers"),
        ("synth generate clps=3", "did you mean clips?"),
        ("synth generate +clips=3", "there is an option clips; leave out the +"),
        ("synth generate ~clips", "options cannot be removed"),
        ("synth generate clips", "clips: expected key=value, as in clips=..."),
        ("synth generate clips=abc", "clips=abc: expected a whole number"),
        ("synth generate clips=1.5", "clips=1.5: expected a whole number"),
        ("synth generate clips=null", "clips=null: expected a whole number"),
        ("synth generate clips=[1]", "clips=[1]: expected a whole number"),
        ("synth generate clips=1,2", "clips=1,2: several values are tried in turn with -m"),
        ("dmae capture data=set data.frames=10", "expected a list of whole numbers, as data.frames=[...]"),
        ("synth generate rig=set", "ring, shelf, studio5; a folder is rig.path=set"),
        ("dmae stress data=set levels.jitter=1,2", "a list is written as levels.jitter=[a,b]"),
        ("dmae review clip=set blank=1", "blank=1: expected a list of whole numbers, as blank=[1]"),
        ("synth generate scene.persons=2", "scene.persons=2: expected a list of whole numbers"),
        ("synth generate scene.randomize=maybe", "scene.randomize=maybe: expected true or false"),
        ("synth generate scene=ofice", "scene=ofice: no such choice; did you mean office?"),
        ("synth generate rig.count=4", "rig.count: no such option; there are rig.name, rig.path, rig.size"),
        ("synth generate scene.views=4", "elsewhere there is rig.ring.views"),
        ("dmae pretrain scene.seconds=2", "scene.seconds: no such option; did you mean seconds?"),
        ("synth generate rig.views=4", "did you mean one of rig.ring.views, rig.dome.views, rig.random.views?"),
        ("synth generate rig.ring.height=1,2", "a list is written as rig.ring.height=[a,b]"),
        ("dmae capture -m data=shelf,opnpose", "data=opnpose: neither a folder nor a format; did you mean openpose?"),
        ("synth generate rig=moon", "rig=moon: no such choice; there are campus, dome"),
        ("synth generate rig=moon", "studio5; one of yours is <folder>/rig/moon.yaml, with --config-dir=<folder>"),
        ("synth generate detector=a/detector/b.yaml", "<folder>/detector/<name>.yaml, there is no such file"),
        ("synth generate rig.ring.height=2", "expected a list of numbers, as rig.ring.height=[1.0,2.7]"),
        ("synth generate rig.ring=3", "rig.ring=3: expected one of its options: rig.ring.views"),
        ("synth generate images=rbg", "images=rbg: no such choice; did you mean rgb?"),
        ("synth generate images=[rbg,depth]", "images=[rbg,depth]: no image 'rbg'; did you mean rgb?"),
        ("synth generate clip=3", "clip: no such option; did you mean clips?"),
        ("synth generate -m images=none,rbg", "images=rbg: no such choice; did you mean rgb?"),
        ("synth generate --config-dri=x", "--config-dri: no such flag; did you mean --config-dir?"),
        ("synth generate --workers 3", "--workers: no such flag; options are given as key=value"),
        ("synth generate --clips 3", "--clips: no such flag; options are given as key=value"),
        ("synth generate --out=runs/a", "--out: no such flag; options are given as key=value"),
        ("synth generate --config-dir", "--config-dir: expected a value after it"),
        ("synth generate --config-dir=none rig=mine", "--config-dir none: no such folder"),
        ("synth generate out=file", "out=file: expected a folder, found a file"),
        ("synth generate out=file/set", "out=file/set: file is a file, not a folder"),
        ("synth compare real=set sim=set mis=3", "did you mean limits.miss?"),
        ("dmae capture", "expected data=... (The recording, clip or data set to read)"),
        ("dmae capture set", "set: expected key=value, as in data=set"),
        ("dmae report set", "set: expected key=value, as in clip=set"),
        ("dmae complete data=set", "data: no such option; did you mean clip?"),
        ("dmae evaluate clip=set", "clip: no such option; did you mean data?"),
        ("dmae stress data=set axes=[object]", "axes=[object]: no axis 'object'; did you mean objects?"),
        ("synth generate rig=mine.toml", "ring, shelf, studio5; a file is rig.path=mine.toml"),
        ("dmae capture data=shelf", "expected data.path=..."),
        ("dmae capture data=openpos", "data=openpos: neither a folder nor a format; did you mean openpose? There"),
        ("dmae capture data=set fill=linar", "fill=linar: no such choice; did you mean linear?"),
        ("dmae capture data=set capture.noise.gate_sigma=1", "did you mean capture.noise.gate_sigmas?"),
        ("dmae evaluate data=set methods=[measured,linaer]", "no method 'linaer'; did you mean linear?"),
        ("dmae train data=set model.encoder.dmi=3", "no such option; did you mean model.encoder.dim?"),
        ("dmae train data=set learning.loss=mes", "learning.loss=mes: no such choice; did you mean mse?"),
        ("dmae export clip=set format=TRC out=x", "format=TRC: no such choice; did you mean trc?"),
        ("dmae export clip=set format=npy out=x", "format=npy: no such choice; did you mean npz?"),
        ("dmae report clip=set out=set", "out=set: expected a file to write, found a folder"),
        ("dmae regress", "expected solver=..."),
        ("dmae run P01/trial_03", "P01/trial_03: expected key=value, as in videos=P01/trial_03"),
        ("dmae run fps=29,97", "fps=29,97: expected a number with a decimal point, fps=29.97"),
    ],
)  # fmt: skip
def test_a_mistyped_option_is_refused_before_anything_is_loaded(folder, arguments, said, monkeypatch):
    program, *rest = arguments.split(" ")
    monkeypatch.setattr("dmae.cli._run_hydra", lambda *_: pytest.fail("Hydra was started"))
    done = run_command(folder, program, *rest)
    assert done.returncode == 1
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""


def test_a_folder_of_weights_is_a_method(tmp_path):
    (tmp_path / "model.json").touch()
    override = f"methods=[linear,{tmp_path}]"
    assert checked(DMAE.commands["evaluate"].options(), [override], {"--info"}) == [override]
    with pytest.raises(ValueError, match="no method"):
        checked(DMAE.commands["evaluate"].options(), [f"methods=[linear,{tmp_path.parent}]"], {"--info"})


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["dmae", "capture", "data=set", "smooth=-1"], "smooth=-1: expected seconds, 0 (no smoothing) or more"),
        (["dmae", "capture", "data=set", "data.path='a"], "data.path='a: cannot be read; look at its quotes"),
        (["dmae", "capture", "data=set", "out=${nope}"], "Interpolation key 'nope' not found"),
        (["dmae", "capture", "data=set", "hydra.verbos=true"], "Key 'verbos' not in 'HydraConf'"),
        (["dmae", "complete", "clip=3"], "clip=3: no such file or folder. Expected: Folder of a c"),
        (["dmae", "report", "clip=3"], "clip=3: no such file or folder. Expected: Folder of a c"),
        (["dmae", "export", "clip=3", "out=x.npz"], "clip=3: no such file or folder. Expected: Folder of a clip"),
    ],
)
def test_errors_of_the_command_itself_are_one_line(folder, arguments, said):
    done = run_command(folder, *arguments)
    assert done.returncode == 1
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert sorted(path.name for path in folder.iterdir()) == ["file", "set"]


def test_an_error_of_the_system_names_the_file_and_no_number(folder, monkeypatch):
    def denied(*_):
        raise PermissionError(13, "Permission denied", "set/clip.json")

    monkeypatch.setattr("dmae.cli._run_hydra", denied)
    done = run_command(folder, "dmae", "report", "clip=set")
    assert done.stderr.strip() == "dmae report: error: set/clip.json: Permission denied"


def test_the_whole_error_is_shown_on_demand(folder, monkeypatch):
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    with pytest.raises(ValueError, match="nothing to report"):
        run_command(folder, "dmae", "report")


@pytest.mark.parametrize(
    ("command", "given", "taken"),
    [
        ("report", "scores=set", "scores=[set]"),
        ("report", "scores=[set]", "scores=[set]"),
        ("report", "scores='a,b'", "scores=['a,b']"),
        ("capture", "data.cameras=left", "data.cameras=[left]"),
        ("regress", "skip=clean", "skip=[clean]"),
    ],
)
def test_one_name_is_short_for_a_list_of_it(command, given, taken):
    assert checked(DMAE.commands[command].options(), [given], ["--cfg", "job"]) == [taken]


@pytest.mark.parametrize(
    "text",
    [
        "Grüße & Co/Füße 1",
        "日本/walk",
        "Tom's clips",
        "take (2)",
        "a=b",
        "~/x",
        "Shot[1]",
        "é\\",
        "\\'é'\\\\",
    ],
)
def test_paths_and_texts_of_any_characters_need_no_quotes(text):
    assert compose(DMAE.commands["export"], ["clip=set", f"out={text}"]).out == text
    about = compose(SYNTH.commands["export"], ["data=set", "out=x", f"about.creator={text}"]).about
    assert about.creator == text
    options = ["data=openpose", "data.path=x", f"data.cameras=[left,{text}]"]
    assert compose(DMAE.commands["capture"], options).data.cameras == ["left", text]


@pytest.mark.parametrize("text", ["Müller, Hans/01", "O'Neill, (links)", "a,b"])
def test_a_text_with_commas_is_one_text_unless_several_are_tried_in_turn(text):
    assert compose(DMAE.commands["export"], ["clip=set", f"out={text}"]).out == text
    assert len(checked(DMAE.commands["export"].options(), ["clip=set", "out=a,b"], ["--multirun"])) == 2


def test_a_folder_with_a_comma_is_one_recording(folder):
    (folder / "Müller, Hans").mkdir(exist_ok=True)
    data = f"{folder}/Müller, Hans"
    assert compose(DMAE.commands["capture"], [f"data={data}", "out=x"]).data.path == data


@pytest.mark.parametrize("value", ["['é'", "[[é]", "'é", "${é"])
def test_quotes_and_brackets_of_the_user_are_left_to_the_user(value):
    with pytest.raises(ValueError, match=r"cannot be read; look at its quotes and brackets"):
        checked(DMAE.commands["export"].options(), ["clip=set", f"out={value}"])


def test_a_pattern_tries_all_presets_that_match(folder):
    done = run_command(folder, "synth", "generate", "-m", "rig=glob(r*)", "clips=0")
    assert "clips: expected 1 or more" in done.stderr


def test_entries_of_a_dictionary_are_options(folder):
    done = run_command(folder, "synth", "generate", "motion.weights.kick=3", "clips=0")
    assert "clips: expected 1 or more" in done.stderr


def test_the_configuration_is_printed_without_what_is_needed_to_run(folder):
    done = run_command(folder, "synth", "generate", "--cfg", "job", "scene.seconds=2")
    assert done.returncode == 0
    assert "seconds: 2.0" in done.stdout
