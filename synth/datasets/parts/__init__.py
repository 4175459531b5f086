"""Parts of data sets: merge data sets that were made in parts, and list takes and divide them into sets."""
