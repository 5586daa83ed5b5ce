"""Programs that run in an environment of their own: each reads a job, then runs it once for every line it is sent."""
