"""In whose layout is a data set handed on? A file a format, under the decorator `exporter`."""

from synth.datasets.exporters.registry import exporter as exporter
