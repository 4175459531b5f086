"""The five tables of the paper, with published rows and rows measured here."""
