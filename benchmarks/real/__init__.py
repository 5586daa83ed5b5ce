"""Real benches as a standing benchmark: what the diagnosis says, beside what an engineer writes in an afternoon."""
