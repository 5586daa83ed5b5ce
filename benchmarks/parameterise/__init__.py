"""First parameters from real data as a standing benchmark: error on runs that were not used, beside simple models."""
