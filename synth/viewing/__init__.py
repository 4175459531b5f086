"""Images of the rooms of simulated clips. `dmae.viewing` draws the people."""
