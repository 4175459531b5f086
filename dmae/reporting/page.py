"""One self-contained HTML page: a summary, a player, and sections of text, tables and figures."""

import base64
import hashlib
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import jinja2
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure

from dmae.files.contents import write_atomic
from dmae.reporting.tables import Table

_ASSETS = resources.files("dmae.reporting") / "assets"
_SCRIPTS = ("page.js", "decisions.js", "player_data.js", "player_drawing.js", "player.js")
_LARGEST_SVG = 300_000
_WIDE = 6.5  # Inches. A wider figure gets its own row; a narrower one is placed next to a table.
_NUMBER = re.compile(r"[<>±~+-]?\s*\d|-?$")
_THEME = {"#000000": "currentColor", "#ffffff": "var(--page)", "#dddddd": "var(--line)"}
"""Colours of figures that follow the page from light to dark."""


@dataclass(frozen=True)
class CaptionedFigure:
    """A figure to embed, with its caption."""

    caption: str
    figure: Figure

    @property
    def wide(self) -> bool:
        """Whether the figure takes the full width of the page."""
        return self.figure.get_figwidth() > _WIDE

    @property
    def markup(self) -> Markup:
        """The figure as an HTML element: SVG in the page's colours, or PNG if the SVG would be very large."""
        with rc_context({"svg.fonttype": "none", "svg.hashsalt": "dmae"}):
            buffer = io.StringIO()
            self.figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
        text = buffer.getvalue()
        if len(text) <= _LARGEST_SVG:
            drawn = text[text.index("<svg") :]
            drawn = re.sub("#(?:000000|ffffff|dddddd)", lambda found: _THEME[found.group()], drawn)
            return Markup(drawn.replace("<svg ", Markup('<svg role="img" aria-label="{}" ').format(self.caption), 1))
        return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(self.caption, self.png)

    @property
    def png(self) -> str:
        """Base64 of the rendered figure."""
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="png", dpi=90)
        return base64.b64encode(buffer.getvalue()).decode()


@dataclass(frozen=True)
class Section:
    """A heading, followed by text, tables and figures in this order. An empty line in the text separates paragraphs."""

    heading: str
    text: str = ""
    tables: Sequence[Table] = ()
    figures: Sequence[CaptionedFigure] = ()


def write_report(
    path: Path, title: str, sections: Sequence[Section], *, summary: Sequence[str] = (), players: Sequence[dict] = ()
) -> None:
    """Write the page as one file that loads nothing from elsewhere.

    Its content security policy lets the browser run only the scripts of this module. A name that comes from a file can
    therefore never run as a script. Paragraphs of `summary` stand under the title. The player shows clips from
    `dmae.reporting.player.player_data`; without clips there is none.
    """
    script = "\n".join((_ASSETS / name).read_text(encoding="utf-8") for name in _SCRIPTS[: None if players else 2])
    template = jinja2.Template(
        (_ASSETS / "page.html").read_text(encoding="utf-8"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = template.render(
        title=title,
        sections=sections,
        summary=summary,
        alignment=_alignment,
        players=players,
        style=Markup((_ASSETS / "page.css").read_text(encoding="utf-8")),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )
    write_atomic(path, page)


def _alignment(table: Table) -> list[str]:
    """Return a CSS class for each column: sentences and words are left-aligned, numbers are right-aligned."""
    columns = [[row[column] for row in table.rows] for column in range(len(table.header))]
    return [
        "prose" if any(len(cell) > 40 for cell in cells) else "" if all(map(_NUMBER.match, cells)) else "words"
        for cells in columns
    ]
