"""What every room stands on: errors in one sentence, units, files written whole, TOML, settings of JAX."""
