"""WHAT CAN PYTHON DO? The functions of `import dmae`: each command as a function of objects instead of files."""
