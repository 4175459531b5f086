"""The documentation is correct: figures come from files, tutorials were executed, links and files exist."""

import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "tools"))

import equations  # noqa: E402
import pages  # noqa: E402
import reference  # noqa: E402
import results  # noqa: E402
import tutorials  # noqa: E402

from dmae.data.clip import Source  # noqa: E402
from dmae.data.skeleton import SKELETONS  # noqa: E402
from dmae.formats.poses import REGIONS, SOURCE_WORDS  # noqa: E402
from dmae.metrics.registry import metric  # noqa: E402

PAGES = sorted(path for path in DOCS.rglob("*.md"))
FRONT = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
ids = {"ids": lambda path: path.stem if isinstance(path, Path) else str(path)}


def test_readme_is_a_front_door():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 100


def test_pages_are_as_they_are_made():
    assert "<!-- results:" in (ROOT / "README.md").read_text()
    assert not pages.stale(), "run python docs/tools/pages.py"


def test_the_warning_about_stated_regions_has_the_figures_of_the_page():
    page = (DOCS / "explanation/uncertainty.md").read_text()
    held = [int(share) for share in re.findall(r"(\d+) % of \d+ \|", page)]
    assert len(held) == 8 and f"held {min(held)} to {max(held)} %" in REGIONS


def test_a_figure_that_was_typed_over_is_found():
    readme = (ROOT / "README.md").read_text()
    other = re.sub(r"\d\d\.\d", "99.9", readme)
    assert other != readme
    assert pages.filled(other) != other


def test_links_of_pages_lead_somewhere_in_the_repository():
    assert not [(page.name, link) for page in pages.pages() for link in pages.dead_links(page, page.read_text())]


def test_the_page_of_conventions_lists_every_skeleton():
    page = (DOCS / "reference/conventions.md").read_text()
    assert not [name for name in SKELETONS if f"`{name}`" not in page]


def test_tables_of_the_benchmark_name_causes_in_the_order_of_levels():
    """A reader compares the columns of the two tables, which have the same names and different figures."""
    page = (DOCS / "benchmarks/occlusion.md").read_text()
    header, causes = (
        [cell.strip() for cell in re.search(rf"^{re.escape(start)}.*$", page, re.MULTILINE)[0].split("|")]
        for start in ("| method | mm |", "| method | self |")
    )
    assert header[4:9] == causes[2:7] == ["self", "person", "thing", "edge", "burst"]


def test_columns_and_tables_of_sources_use_the_words_of_the_glossary():
    """Of real recordings nobody knows what is hidden: scores call joints unmeasured, and joints of cameras measured."""
    section = (DOCS / "reference/glossary.md").read_text().split("## ")[1]
    meant = {word for row in re.findall(r"^\| ([a-z, ]+) \|", section, re.MULTILINE) for word in row.split(", ")}
    named = {source.name.lower() for source in Source} | {word.split(" (")[0] for word in SOURCE_WORDS.values()}
    assert named | {"visible", "hidden", "unmeasured", "gap"} <= meant
    headings = [column.heading for each in metric.values() for column in metric.find(each.name).columns]
    page = (DOCS / "benchmarks/occlusion.md").read_text()
    headings += re.search(r"^\| method \| mm \| (.*) \|$", page, re.MULTILINE)[1].split(" | ")
    assert {"measured", "unmeasured", "absent", "measured mm"} <= {*headings}
    assert not [each for each in headings if re.search("hidden|denoised|observed|seen|occluded|missing", each)]


def test_a_dead_link_is_found():
    page = DOCS / "index.md"
    text = "[a](how-to/generate.md) [b](gone.md) [c](how-to/index.md#gone) [d](https://x.y/z) `[e](f.md)`"
    assert pages.dead_links(page, text) == ["gone.md", "how-to/index.md#gone"]


def test_pages_read_well_without_being_built():
    """What only the site would turn into text: its templates, equations, attributes and admonitions."""
    for page in pages.pages():
        text = pages.without_markers(re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.DOTALL))
        assert not re.search(r"\{\{|\\\(|\{ ?[.#:]|^!!! |^::: |^=== ", text, re.MULTILINE), page
        assert not re.search(r"^<!-- results: [^\n]*-->[^\n]*<!-- end -->", page.read_text(), re.MULTILINE), page


@pytest.mark.parametrize(
    ("page", "answer"),
    [
        ("biomechanics.md", "# Joint angles for OpenSim"),
        ("animation.md", "**SMPL**: no format holds its parameters"),
        ("motion.md", "| `npz` | AMASS's format (SMPL"),
        ("how_long.md", "| a million frames of two people in five cameras |"),
        ("recording.md", "begins with the first frame of the cameras with offset 0"),
        ("data_set.md", "column `depth`: 16 bit, mm"),
    ],
)
def test_a_question_that_readers_asked_has_an_answer_on_a_page_of_the_index(page: str, answer: str):
    assert answer in (DOCS / "how-to" / page).read_text()
    assert f"]({page})" in (DOCS / "how-to/index.md").read_text()


@pytest.mark.parametrize("page", [*FRONT, *DOCS.glob("benchmarks/*.md")], **ids)
def test_no_measured_figure_is_typed(page: Path):
    """Measured quantities stand in markers; what is left has no such unit behind a number."""
    typed = re.sub(r"<!-- results.*?<!-- end -->|```.*?```|`[^`]*`", "", page.read_text(), flags=re.DOTALL)
    assert not re.findall(r"\d+\.\d+ ?%|\d+ mm\b|\d+ frames/s\b(?! *\.? *Strict)", typed.replace("25 frames/s", ""))


@pytest.mark.parametrize("path", sorted(results.FOLDER.glob("*.json")), **ids)
def test_a_results_file_says_how_it_was_made(path: Path):
    made = json.loads(path.read_text())
    if "tables" in made:
        assert made["measured"]
        assert all(table["command"] and len(table["rows"]) for table in made["tables"].values())
    else:
        assert {"command", "date", "commit", "versions"} <= set(made)


@pytest.mark.parametrize("name", tutorials.names())
def test_a_tutorial_was_executed_since_its_script_changed(name: str):
    assert tutorials.executed(name), "run python docs/tools/tutorials.py"
    assert (tutorials.EXECUTED / f"{name}.png").is_file()


def test_every_example_is_a_tutorial():
    assert {path.stem for path in tutorials.EXAMPLES.glob("*.py")} == set(tutorials.names())


@pytest.mark.parametrize("program", sorted(reference.PROGRAMS))
def test_the_reference_of_commands_has_every_option(program: str):
    page = reference.commands_page(program, options=True)
    for command in reference.PROGRAMS[program].commands.values():
        assert f"## `{command}`" in page
        for member in command.options().walk():
            assert f"`{member.key}" in page


def test_files_that_where_is_what_names_exist():
    named = re.findall(r"`((?:dmae|synth)/[\w/]+\.py)`", (DOCS / "reference/where.md").read_text())
    assert len(named) >= 3
    for name in named:
        assert (ROOT / name).is_file(), name


def test_packages_that_where_is_what_names_are_those_there_are():
    page = (DOCS / "reference/where.md").read_text()
    for package in ("dmae", "synth"):
        for folder in (ROOT / package).iterdir():
            if (folder / "__init__.py").is_file():
                assert f"`{folder.name}`" in page, folder


@pytest.mark.parametrize("page", PAGES, **ids)
def test_command_lines_of_a_page_name_options_that_exist(page: Path):
    """Each `dmae ...` and `synth ...` line is checked as the program itself checks it, up to its values."""
    text = page.read_text().replace("\\\n", " ")
    for block in re.findall(r"```text\n(.*?)```", text, re.DOTALL):
        for line in re.findall(r"^(dmae|synth) ([a-z-]+) ([^#|]*?)(?:\s{2,}.*|#.*)?$", block, re.MULTILINE):
            program, name, arguments = line
            commands = reference.PROGRAMS[program].commands
            assert name in commands, line
            members = list(commands[name].options().walk())
            known = {member.key for member in members}
            dictionaries = tuple(f"{member.key}." for member in members if getattr(member, "keyed", False))
            for argument in arguments.split():
                key, equals, _ = argument.partition("=")
                known_key = key in known or key.startswith(("-", *dictionaries))
                assert known_key or not equals, f"{page.name}: {line}: {key}"


def test_no_two_commands_of_pages_fill_one_folder():
    """A folder with clips of other options is refused, so who follows two pages would be stopped in the second."""
    pages = [ROOT / "README.md", *(ROOT / "docs/how-to").glob("*.md"), *(ROOT / "docs/tutorials").glob("*.md")]
    lines = (each for page in pages for each in page.read_text().replace("\\\n", "").splitlines())
    made: dict[str, set[str]] = {}
    for line in lines:
        command = re.sub(r"\s+#.*| workers=\S+| first=.*", "", line.strip())
        if match := re.match(r"(?:synth generate|dmae detect) .*\bout=(\S+)", command):
            made.setdefault(match[1], set()).add(" ".join(sorted(command.split())))
    assert [commands for commands in made.values() if len(commands) > 1] == []


@pytest.mark.parametrize("page", PAGES, **ids)
def test_equations_of_a_page_are_understood(page: Path):
    """What the converter does not know it leaves with its backslash."""
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.DOTALL)
    for block, inline in re.findall(r"\$\$(.*?)\$\$|\$(?! )([^$\n]*?[^ $])\$", text, re.DOTALL):
        assert "\\" not in equations.convert(block or inline), block or inline


def test_every_option_in_running_text_exists():
    """Names such as `capture.th_p` in the explanations are options of a command."""
    known = {member.key for program in reference.PROGRAMS.values() for command in program.commands.values()
             for member in command.options().walk()}  # fmt: skip
    roots = {key.split(".")[0] for key in known if "." in key}
    # Recipes add options, and arrays in files have such names.
    for page in (page for page in PAGES if page.stem not in ("files", "add")):
        for key in re.findall(r"`([a-z_0-9]+(?:\.[a-z_0-9]+)+)(?:=[^`]*)?`", page.read_text()):
            if key.split(".")[0] in roots and not key.endswith((".py", ".json", ".md", ".yaml")):
                assert key in known, f"{page.name}: {key}"


def test_the_terms_of_every_model_in_the_package_are_stated():
    named = set(re.findall(r"`dmae/models/(\w+)", (DOCS / "reference/licences.md").read_text()))
    assert named == {path.stem for path in (ROOT / "dmae/models").iterdir()}


@pytest.mark.parametrize("page", [*PAGES, *FRONT], **ids)
def test_what_a_page_calls_is_there_after_the_import_that_it_shows(page: Path):
    called = set(re.findall(r"\b(dmae|synth)\.(\w+)[\w.]*\(", page.read_text()))
    assert not [f"{package}.{name}" for package, name in called if name not in import_module(package).__all__]


def test_equations_become_mathml():
    html = '<div class="arithmatex">\\[\\sigma^2 = 1\\]</div> <span class="arithmatex">\\(x\\)</span>'
    assert equations.to_mathml(html).count("<math") == 2
    assert "arithmatex" not in equations.to_mathml(html)


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_needs_no_network(tmp_path: Path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for page in (tmp_path / "site").rglob("*.html"):
        html = page.read_text()
        loaded = re.findall(r'<(?:script|img|iframe)[^>]+src="(https?:[^"]+)"', html)
        loaded += re.findall(r'<link[^>]+rel="(?:stylesheet|preconnect|icon)"[^>]+href="(https?:[^"]+)"', html)
        assert not loaded, page
        assert "\\(" not in html and "arithmatex" not in html, page
