"""The registry of exporters of data sets.

An exporter is a function under the decorator `exporter` in a module of this package. It takes a `Selection` of clips
and the folder to write, and returns what it wrote, by split.
"""

from dataclasses import dataclass

from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class Exporter(Entry):
    """A function of a `Selection` and the folder to write.

    Attributes:
        pictures: Whether it needs images of colour.
        skeleton: Skeleton that is written where none is asked for.
        only: Whether the format has no other skeleton.
        validation: Whether the format's readers insist on a split for validation.
    """

    pictures: bool = True
    skeleton: str = "coco17"
    only: bool = False
    validation: bool = False


exporter = Registry("exporter", Exporter, __package__, option="format")
