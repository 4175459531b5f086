"""What does the paper do, alone? Its network, masks, loss and schedule, without this package's other methods."""
