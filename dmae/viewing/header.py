"""The strip above the views: the name of the clip, a legend of the marks, and counts of joints."""

import numpy as np
from PIL import Image, ImageDraw

from dmae.data.clip import Source
from dmae.reporting.words import counted
from dmae.viewing.canvas import FAINT, INK, PAPER, RED, RGB, Mark, draw_mark, font, person_colour
from dmae.viewing.layers import DETECTED, TRUE, first_joints
from dmae.viewing.occlusion import COLOURS, MEANINGS
from dmae.viewing.overlay import Overlay

Item = tuple[str, tuple[Mark, RGB] | None]
"""A text, and the mark in front of it."""
_LETTERS, _SPACE, _MARK = font(14), 18, 17


def header(overlay: Overlay, width: int) -> np.ndarray:
    """Draw the strip (h, width, 3) uint8 with the number of lines that the text needs."""
    clip, shown = overlay.clip, overlay.shown
    persons = 0 if shown is None else shown.xyz.shape[1]
    about = [counted(persons, "person")] if persons else []
    about += [counted(len(clip.rig), "camera"), f"{len(clip) / clip.fps:.1f} s"]
    lacking = [(f"no {' and no '.join(overlay.layers.lacking)}", None)] if overlay.layers.lacking else []
    first = _wrapped([(f"clip {clip.id}", None), (", ".join(about), None), *lacking], width)
    lines = first + [line for items in _legend(overlay) for line in _wrapped(items, width)]
    canvas = np.full((12 + 24 * len(lines), width, 3), PAPER, np.uint8)
    texts = []
    for number, line in enumerate(lines):
        x, y = 10.0, 8 + 24 * number
        for words, mark in line:
            if mark:
                draw_mark(canvas, np.array([x + 5.5, y + 8.5]), *mark, 2)
                x += _MARK
            texts.append(((x, y), words, INK if mark or number < len(first) else FAINT))
            x += _LETTERS.getlength(words) + _SPACE
    picture = Image.fromarray(canvas)
    draw = ImageDraw.Draw(picture)
    for place, words, colour in texts:
        draw.text(place, words, colour, _LETTERS)
    return np.asarray(picture)


def _legend(overlay: Overlay) -> list[list[Item]]:
    """Return the lines below the first line."""
    layers, clip = overlay.layers, overlay.clip
    if layers.occlusion:
        return _occlusion_legend(overlay)
    items: list[Item] = [("detected", (Mark.CROSS, DETECTED))] if layers.detections else []
    if not layers.poses:
        there = [] if overlay.shown is None else np.isfinite(overlay.shown.xyz).any((0, 2, 3))
        items += [(f"true person {p}", (Mark.RING, person_colour(p))) for p in np.flatnonzero(there)]
        return [items] if items else []
    items += [("true", (Mark.RING, TRUE))] if layers.truth else []
    source = clip.poses.source[:, :, first_joints(clip.poses)]
    there = (source != Source.ABSENT).any(-1)
    total = max(1, there.sum() * source.shape[-1])
    completed = (source == Source.COMPLETED).sum() / total
    measured = clip.poses.measured[:, :, first_joints(clip.poses)].sum() / total
    if layers.measured:
        items += [(f"person {p}", (Mark.DISC, person_colour(p))) for p in range(source.shape[1]) if there[:, p].any()]
    if layers.completed and completed:
        items += [("completed: no camera measured it", (Mark.SQUARE, RED))]
    shares = f"joints of people who are present: {measured:.0%} measured, {completed:.0%} completed"
    return [items, [(f"{shares}, {max(0.0, 1 - measured - completed):.0%} absent", None)]]


def _occlusion_legend(overlay: Overlay) -> list[list[Item]]:
    clip, joints = overlay.clip, first_joints(overlay.clip.truth)
    codes = clip.occlusion.visibility[..., joints]
    there = np.isfinite(clip.truth.xyz[:, :, joints]).all(-1)
    visible_views = clip.occlusion.visible_views[..., joints][there]
    seen = np.bincount(visible_views, minlength=len(clip.rig) + 1) / max(1, there.sum())
    legend = [
        (f"{meaning} {np.mean(codes == cause):.0%}", (Mark.DISC, COLOURS[cause])) for cause, meaning in MEANINGS.items()
    ]
    if overlay.layers.detections:
        legend.insert(0, ("detected", (Mark.CROSS, DETECTED)))
    counts = [(f"{number}: {share:.0%}", None) for number, share in enumerate(seen) if share > 0]
    return [legend, [("joints by number of cameras that see them", None), *counts]]


def _wrapped(items: list[Item], width: int) -> list[list[Item]]:
    """Wrap texts with their marks, if any, into lines of `width` px."""
    lines, x = [[]], 10.0
    for words, mark in items:
        needed = _LETTERS.getlength(words) + _SPACE + (_MARK if mark else 0)
        if lines[-1] and x + needed > width:
            lines, x = [*lines, []], 10.0
        lines[-1].append((words, mark))
        x += needed
    return lines
