"""What is a skeleton? The type `Skeleton`, its definitions in files, and the size of bodies."""
