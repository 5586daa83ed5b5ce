"""Public data sets by name: fetched once, held to the checksum of what was read here, with their licence."""

from jaxmodel.data.public.fetching import DataSet, data_sets, fetch

__all__ = ["DataSet", "data_sets", "fetch"]
