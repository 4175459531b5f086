"""WHAT CAN PYTHON DO? The verbs of `import synth`: each command as a function, with objects where it has files."""
