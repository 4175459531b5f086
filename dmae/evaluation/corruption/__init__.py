"""What goes wrong with a recording: corruptions of any clip, each at any level, a file each."""
