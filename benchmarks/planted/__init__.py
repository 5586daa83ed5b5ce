"""Planted faults: a fault is put into measured data, and the diagnosis must tell it where it belongs."""
