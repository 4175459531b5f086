"""Tests, in the folders of what they test. A package, so that none of the same name that is installed hides it."""
