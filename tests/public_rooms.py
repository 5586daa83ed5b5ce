"""The packages whose `__all__` is the public API, as CONTRIBUTING.md lists them."""

PUBLIC = (
    "jaxmodel",
    "jaxmodel.effects",
    "jaxmodel.operation",
    "jaxmodel.plots",
    "jaxmodel.sensitivity",
    "jaxmodel.sweeps",
)
