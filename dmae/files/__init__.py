"""IS THIS FILE SAFE TO READ? Sizes, nesting, names and numbers in untrusted files, checked before use."""
