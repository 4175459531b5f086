"""Layouts of other programs: each is a function with the decorator `exporter` in a module of this package.

It takes a `Selection` of clips and the folder to write, and returns counts of what it wrote, by split.
"""

from dataclasses import dataclass

from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class Exporter(Entry):
    """An exporter: a function that takes a `Selection` and the folder to write, and returns counts by split."""

    images: bool = True  # Whether it needs colour images
    skeleton: str = "coco17"  # Default skeleton
    only: bool = False  # Whether the format supports only this skeleton
    validation: bool = False  # Whether readers of the format require splits for training and validation


exporter = Registry("exporter", Exporter, __package__, option="format", arguments=("selection", "out"))
