"""Options of the verbs, as on the command line."""


def composed(command: str, *overrides: str):
    """Return the configuration of a command of `dmae`.

    Args:
        command: Its name.
        overrides: Options, as "max_minutes=10".

    Raises:
        ValueError: there is no such option, or it does not take the value.
    """
    from dmae.cli import DMAE, compose

    # The commands require data, which is given as objects here.
    return compose(DMAE.commands[command], ["data=clip", "data.path=-", *overrides])
