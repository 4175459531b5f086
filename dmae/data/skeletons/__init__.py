"""What is a skeleton? The type, definitions in files, and the size of bodies."""
