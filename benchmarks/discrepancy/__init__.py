"""The proving ground of the diagnosis: blind cases by another path, and how often the diagnosis is right about them."""
