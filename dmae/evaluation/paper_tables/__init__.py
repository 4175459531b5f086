"""What did the paper report, and what is measured here? Its five tables, published rows and measured ones."""
