"""Convert LaTeX in pages to MathML when the pages are built. Browsers draw MathML without a script."""

import html
import re

from latex2mathml.converter import convert

_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def to_mathml(page: str) -> str:
    """Replace the equations that `pymdownx.arithmatex` marked in HTML."""
    page = _BLOCK.sub(lambda found: convert(html.unescape(found[1]).strip(), display="block"), page)
    return _INLINE.sub(lambda found: convert(html.unescape(found[1]).strip()), page)
