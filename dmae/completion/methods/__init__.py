"""Completion methods, a file each: how joints that no camera measured are filled.

`METHODS` holds those that need no training, by name; `find_method` looks up any. To add one, write a module in this
folder with a function under the decorator `completion_method`.
"""

from dmae.completion.methods.registry import METHODS, CompletionMethod, completion_method, find_method

__all__ = ["METHODS", "CompletionMethod", "completion_method", "find_method"]
