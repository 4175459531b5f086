"""What do pictures of a data set show? Rendered from stored states, now or later, and checked."""
