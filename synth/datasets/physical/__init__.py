"""What do bodies bear, and where is their skin? Labels that only physics has, added to clips that exist."""
