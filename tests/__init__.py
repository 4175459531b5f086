"""Tests, in folders that mirror the packages. A package itself, so that no installed package `tests` hides it."""
