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


PAGES = ["README.md", "CONTRIBUTING.md", *(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/**/*.md"))]


@pytest.mark.parametrize("page", PAGES)
def test_pages_are_plain(page):
    lines = (ROOT / page).read_text().splitlines()
    assert [f"{number}: {line}" for number, line in enumerate(lines, 1) if SENTENCES.search(line)] == []


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
