"""What speaks for an addition: evidence, and readings left out."""
