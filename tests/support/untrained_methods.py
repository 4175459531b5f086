"""The completion methods that need no training."""

from dmae.completion.methods import completion_method

UNTRAINED = {name: method.load() for name, method in completion_method.items() if not method.learned}
"""Functions of poses and their frames per second, by name."""
