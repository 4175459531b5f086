"""Exporters of data sets to the layouts of other programs: one module per layout, with the decorator `exporter`."""

from synth.datasets.exporters.selection import exporter as exporter
