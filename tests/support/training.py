"""Small networks, and configurations of training, changed by the names of their options."""

from dataclasses import fields, replace

from dmae.completion.config import CodesConfig, DecoderConfig, EncoderConfig, ModelConfig, TrainConfig

TINY_NETWORK = ModelConfig(
    frames=5,
    encoder=EncoderConfig(dim=16, depth=1, heads=2, head_dim=8, mlp=32),
    decoder=DecoderConfig(dim=8),
    codes=CodesConfig(signal=8),
)
SMALL_NETWORK = ModelConfig(
    frames=5,
    encoder=EncoderConfig(dim=32, depth=1, heads=2, head_dim=16, mlp=64),
    decoder=DecoderConfig(dim=32),
    codes=CodesConfig(signal=16),
)
"""Large enough to learn something in seconds."""


def changed(config: TrainConfig, **options) -> TrainConfig:
    """Return a configuration with other options, at the top or in `examples` and `learning`."""
    parts = {"examples": config.examples, "learning": config.learning}
    for group, part in parts.items():
        names = {field.name for field in fields(part)}
        inner = {name: options.pop(name) for name in names & options.keys()}
        options[group] = replace(part, **inner)
    return replace(config, **options)
