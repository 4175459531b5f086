"""Which layouts can a data set be exported in? One module per layout, with the decorator `exporter`."""

from synth.datasets.exporters.registry import exporter as exporter
