"""Hooks of the mkdocs build: what the site has beyond the pages in the repository.

These are all options of the commands, documented functions and types, and equations as MathML. A page that differs from
what `docs/tools/pages.py` writes is a warning, and a warning fails a strict build.
"""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import equations
import pages
import reference
import results
import tutorials
from mkdocs.plugins import get_plugin_logger

log = get_plugin_logger("documentation")
_API = re.compile(r"<!-- api: (\S+) ?(.*) -->")
_LINK = re.compile(r"\[([^\]]*)\]\(([^)\s:]+)\)")


def on_files(files, config):
    """Check that the pages are as they are made."""
    for page in pages.stale():
        log.warning(f"{page} is not as made; run python docs/tools/pages.py")
    return files


def on_page_markdown(markdown, page, config, files):
    """Complete a page: options of commands, documentation from the code, links to files that are not on the site."""
    folder = Path(page.file.abs_src_path).parent
    if name := re.fullmatch(r"reference/(\w+)_commands\.md", page.file.src_uri):
        markdown = reference.commands_page(name[1], options=True)

    def inside(found: re.Match) -> str:
        target = (folder / found[2].partition("#")[0]).resolve()
        return found[0] if target.is_relative_to(pages.DOCS) else found[1]

    parts = re.split(r"(```.*?```)", _API.sub(_documented, pages.without_markers(markdown)), flags=re.DOTALL)
    return "".join(part if part.startswith("```") else _LINK.sub(inside, part) for part in parts)


def _documented(found: re.Match) -> str:
    """Return the block of mkdocstrings for `<!-- api: object option:value ... -->`."""
    options = [f"      {option.replace(':', ': ')}" for option in found[2].split()]
    return "\n".join([f"::: {found[1]}", *(["    options:", *options] if options else [])])


def on_page_content(html, page, config, files):
    """Turn equations into MathML."""
    return equations.to_mathml(html)


def on_config(config):
    config["watch"] += [str(tutorials.EXAMPLES), str(results.FOLDER)]
    return config
