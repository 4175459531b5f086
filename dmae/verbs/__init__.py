"""What can I do? Each command as a function of objects instead of files: the functions of `import dmae`."""
