"""The paper, beside what the engine gives: its printed numbers, the simulations of each, and the report of both."""
