"""How do 2D pose detectors err? One file for each kind of error.

An error is a frozen dataclass that is switched off by default, with a method `apply(view: View) -> View`. To add one,
write its file here and give `synth.detector.config.DetectorConfig` a field of it, in the order of application; options,
help and tests follow. An error outside this package is a function, named in `detector.custom`.
"""
