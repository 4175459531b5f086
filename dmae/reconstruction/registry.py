"""The registry of capture methods: published systems besides the capture of this package (`capture.method`).

To add one, write a function of a clip and a configuration with the decorator `capture_method` in a file of
`dmae/reconstruction/systems`. Listing them imports none.
"""

from dataclasses import dataclass

from dmae.registry import Entry, Registry

ADAPTIVE = "adaptive"
"""Name of the capture of this package."""


@dataclass(frozen=True)
class CaptureMethod(Entry):
    """A system: its function takes a clip of bodies as large as people, and a configuration, and returns poses."""

    paper: str = ""  # Authors and year, as in tables


capture_method = Registry("capture_method", CaptureMethod, "dmae.reconstruction.systems", option="capture.method")
