"""Hooks of the mkdocs build: generate the pages of tutorials and commands, fill in results and equations.

Stale or missing content is a warning, and a warning fails a strict build.
"""

import sys
from pathlib import Path

from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
import equations
import reference
import results
import tutorials
from mkdocs.plugins import get_plugin_logger

log = get_plugin_logger("documentation")


def on_files(files, config):
    """Add the generated pages."""
    pages = {}
    for name in tutorials.names():
        try:
            pages[f"tutorials/{name}.md"] = tutorials.page(name)
        except ValueError as error:
            log.warning(error)
    pages |= {f"reference/{name}_commands.md": reference.commands_page(name) for name in ("dmae", "synth")}
    pages["reference/corruptions.md"] = reference.corruptions_page()
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown, page, config, files):
    """Fill in figures from `docs/results/`."""
    try:
        return results.expanded(markdown)
    except (FileNotFoundError, LookupError) as error:
        log.warning(f"{page.file.src_uri}: {error!r}")
        return markdown


def on_page_content(html, page, config, files):
    """Turn equations into MathML."""
    return equations.to_mathml(html)


def on_config(config):
    config["watch"] += [str(tutorials.EXAMPLES), str(results.FOLDER)]
    return config
