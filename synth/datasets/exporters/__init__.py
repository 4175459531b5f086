"""Layouts of other programs: each is a function with the decorator `exporter` in a module of this package.

It takes a `Selection` of clips and the folder to write, and returns counts of what it wrote, by split.
"""

from dataclasses import dataclass

from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class Exporter(Entry):
    """An exporter: a function that takes a `Selection` and the folder to write, and returns counts by split.

    Attributes:
        pictures: Whether it needs colour images.
        skeleton: Default skeleton.
        only: Whether the format supports only this skeleton.
        validation: Whether readers of the format require splits for training and validation.
    """

    pictures: bool = True
    skeleton: str = "coco17"
    only: bool = False
    validation: bool = False


exporter = Registry("exporter", Exporter, __package__, option="format")
