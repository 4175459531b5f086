"""What goes wrong with a recording? Corruptions of any clip, each at any level."""
