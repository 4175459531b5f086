"""What is in a data set? Counts and histograms of its clips, as a page and a picture."""
