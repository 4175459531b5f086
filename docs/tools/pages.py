"""Write what pages contain that is made: tables of results, tutorials, lists of commands, functions and corruptions.

    python docs/tools/pages.py            # write
    python docs/tools/pages.py --check    # fail where a page differs, or a link leads nowhere

Pages are read in the repository as they are and on the site as `mkdocs` builds them, so everything stands in the files.
`<!-- results: expression -->` and `<!-- end -->` enclose the value of an expression of `docs/tools/results.py`.
"""

import re
import sys
from pathlib import Path

import reference
import results
import tutorials

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_MARKER = re.compile(r"(<!-- results: (.+?) -->)(.*?)(<!-- end -->)", re.DOTALL)
_CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)


def pages() -> list[Path]:
    """Return the pages that are read: at the top of the repository and in `docs/`."""
    return [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]


def filled(page: str) -> str:
    """Return a page with what stands between its markers made anew."""

    def anew(found: re.Match) -> str:
        value = results.evaluated(found[2])
        return f"{found[1]}\n{value}\n{found[4]}" if found[3].startswith("\n") else f"{found[1]}{value}{found[4]}"

    return _MARKER.sub(anew, page)


def without_markers(page: str) -> str:
    """Return a page with the values of its expressions only."""
    return _MARKER.sub(r"\3", page)


def made() -> dict[Path, str]:
    """Return the pages that are made whole, by their paths; without tutorials whose scripts changed since they ran."""
    return {
        DOCS / "reference/dmae_commands.md": reference.commands_page("dmae"),
        DOCS / "reference/synth_commands.md": reference.commands_page("synth"),
        DOCS / "reference/corruptions.md": reference.corruptions_page(),
        **{
            DOCS / f"tutorials/{name}.md": tutorials.page(name)
            for name in tutorials.names()
            if tutorials.executed(name)
        },
    }


def stale() -> dict[Path, str]:
    """Return the pages that differ from what they should be, with what they should be."""
    wanted = made()
    wanted |= {page: filled(page.read_text()) for page in pages() if page not in wanted}
    return {page: text for page, text in wanted.items() if not page.is_file() or page.read_text() != text}


def headings(page: str) -> set[str]:
    """Return the anchors of a page: its headings as code hosts and mkdocs name them."""
    names = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", page, flags=re.DOTALL), re.MULTILINE)
    texts = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", name).strip().lower() for name in names]
    return {re.sub(r"[^\w\- ]", "", text).replace(" ", "-") for text in texts}


def dead_links(page: Path, text: str) -> list[str]:
    """Return the relative links of a page that lead to no file, or to no heading in it."""
    dead = []
    for link in re.findall(r"\]\(([^)\s]+)\)", _CODE.sub("", text)):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        if re.match(r"[a-z]+:", link):
            continue
        if not target.exists() or (anchor and anchor not in headings(target.read_text())):
            dead.append(link)
    return dead


if __name__ == "__main__":
    differing = stale()
    if "--check" in sys.argv:
        faults = [f"{page.relative_to(ROOT)} is not as made; run python docs/tools/pages.py" for page in differing]
        faults += [f"examples/{name}.py changed; run python docs/tools/tutorials.py"
                   for name in tutorials.names() if not tutorials.executed(name)]  # fmt: skip
        faults += [f"{page.relative_to(ROOT)}: dead link {each}" for page in pages()
                   for each in dead_links(page, page.read_text())]  # fmt: skip
        sys.exit("\n".join(faults) or 0)
    for page, text in differing.items():
        page.write_text(text)
        print(page.relative_to(ROOT))
