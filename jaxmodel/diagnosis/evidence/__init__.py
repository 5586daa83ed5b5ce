"""Evidence for an addition: expected gains, fits, and cross-validation."""
