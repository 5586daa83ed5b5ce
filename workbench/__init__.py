"""Command line, report and web page: the only room that talks to people."""
