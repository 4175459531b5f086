"""Errors of 2D pose detectors: one file for each kind of error.

An error is a frozen dataclass that is switched off by default, with a method `apply(view: View) -> View`. To add one,
write its file here and add a field for it to `synth.detector.config.DetectorConfig`, in the order of application.
Options, help and tests follow from this field. An error outside this package is a function, named in `detector.custom`.
"""
