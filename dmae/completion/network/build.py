"""From a configuration to a network."""

from dmae.completion.network.config import ModelConfig
from dmae.completion.network.paper import DMAE
from dmae.completion.network.residual import ResidualDMAE


def build_network(config: ModelConfig, joints: int) -> DMAE:
    """Return an untrained network for a number of joints: the paper's, or the default one if `config.residual`."""
    return (ResidualDMAE if config.residual else DMAE)(config, joints)
