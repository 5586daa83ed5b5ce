"""The physics-based proving ground: reality is PyBaMM's porous-electrode models, so that no effect is exactly true."""
