"""Command line, reports, and the workbench in a browser: the only room that talks to people."""
