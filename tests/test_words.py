"""The field's words: names and sentences of the project avoid the words that it has left behind."""

import ast
import re
from collections import defaultdict

import pytest

from tests.support.source_tree import ROOT, identifiers, modules, texts, tree, words_of

LEFT_BEHIND = {
    "recalled", "remembered", "recalling", "hints", "told", "tells", "leads", "mended", "mending", "mends", "blind",
    "rough", "roughness", "whose", "whom", "somebody", "nobody", "everybody", "strangers", "strange", "rejoin",
    "punched", "disturb", "disturbed", "legroom", "naturalness", "luck", "unrest", "mistakes", "lively", "journey",
    "journeys", "revive", "revived", "lest",
}  # fmt: skip
"""Words that no name of a module, function, class, argument or variable holds."""

SENTENCES = re.compile(
    r"\b(somebody|nobody|everybody|whom|lest|but for|is told|are told|was told|made[- ]up|who is who|thereof|nought|"
    r"therein|save for|legroom|luck)\b",
    re.IGNORECASE,
)
"""What no docstring, message or comment says."""

LITERARY = re.compile(r"(?<![\w.])(whose|alike|anew|at once|so many|told)(?![\w.])", re.IGNORECASE)
"""What neither pages nor modules say."""
EXEMPT = "dmae.completion.weights"
"""It names parts of older files."""
ON_PAGES = re.compile(
    r"(?<![\w.\"/])(beside|mended|in step|says so|of yours|this is so|some \d+)(?![\w.\"/])", re.IGNORECASE
)
"""What pages do not say in addition: some of these words are names or values in code."""


@pytest.mark.parametrize("name", sorted(modules()))
def test_names_are_plain(name):
    path = modules()[name]
    assert not set(words_of(path.stem)) & LEFT_BEHIND
    found = {
        f"{line}: {identifier}" for line, identifier in identifiers(path) if set(words_of(identifier)) & LEFT_BEHIND
    }
    assert found == set()


@pytest.mark.parametrize("name", sorted(modules()))
def test_sentences_are_plain(name):
    found = [f"{line}: {match.group()}" for line, text in texts(modules()[name]) if (match := SENTENCES.search(text))]
    assert found == []


@pytest.mark.parametrize("name", sorted(modules().keys() - {EXEMPT}))
def test_sentences_are_not_literary(name):
    found = [f"{line}: {match.group()}" for line, text in texts(modules()[name]) if (match := LITERARY.search(text))]
    assert found == []


FRONT = ["README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"]
PAGES = [*FRONT, *(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/**/*.md"))]


@pytest.mark.parametrize("page", PAGES)
def test_pages_are_plain(page):
    lines = (ROOT / page).read_text().splitlines()
    banned = (SENTENCES, LITERARY) if page == "README.md" else (SENTENCES, LITERARY, ON_PAGES)
    assert [
        f"{number}: {line}" for number, line in enumerate(lines, 1) if any(each.search(line) for each in banned)
    ] == []


def test_no_two_public_classes_share_a_name():
    places = defaultdict(list)
    for name, path in modules().items():
        for node in tree(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(name)
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_no_path_of_one_machine_is_named():
    machine = re.compile(r"(?<![\w.])/(work|root|home)/")
    found = [
        path
        for path in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *modules().values())
        if machine.search(path.read_text())
    ]
    assert found == []
