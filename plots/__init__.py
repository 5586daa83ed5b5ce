"""Pictures for reports: each function returns a matplotlib Figure, ready for print, and touches no global state."""
