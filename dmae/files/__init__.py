"""IS THIS FILE SAFE TO READ? Sizes, nesting, names and numbers in files from elsewhere, checked before use."""
