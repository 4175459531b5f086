"""WHAT CAN PYTHON DO? The functions of `import synth`: each command as a function of objects instead of files."""
