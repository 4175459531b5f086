"""What does the report say of clips? Counts, errors and moments of each, and the page made of them."""
