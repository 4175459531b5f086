"""The functions of `import synth`: each command as a function of Python objects instead of files."""
