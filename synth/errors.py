"""Errors that every package of the generator may raise."""


class FailedSimulation(ValueError):
    """A clip cannot be used; the message says why."""
