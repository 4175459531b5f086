"""What does the network look like? The paper's (`paper`), the default one (`residual`), and their layers."""
