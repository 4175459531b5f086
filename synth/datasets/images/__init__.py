"""Images of data sets: render them from stored body states, at any time, and check them."""
