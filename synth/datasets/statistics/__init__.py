"""Statistics of a data set: counts and histograms of its clips, as a page with a figure."""
