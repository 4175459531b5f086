"""Configurations of training, changed by the names of their options."""

from dataclasses import fields, replace

from dmae.completion.config import TrainConfig


def changed(config: TrainConfig, **options) -> TrainConfig:
    """Return a configuration with other options, at the top or in `examples` and `learning`."""
    parts = {"examples": config.examples, "learning": config.learning}
    for group, part in parts.items():
        names = {field.name for field in fields(part)}
        inner = {name: options.pop(name) for name in names & options.keys()}
        options[group] = replace(part, **inner)
    return replace(config, **options)
