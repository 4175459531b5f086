"""What was not seen: joints on which fewer than two cameras agree, completed."""
