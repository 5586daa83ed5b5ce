"""The work of one session, in a process of its own: import, calibration, refits, diagnosis, sweeps.

Started as `python -m jaxmodel.app.browser.worker`. It reads the session's folder and then jobs from stdin, a line of
JSON each, and leaves progress and results as files in that folder. It ends when its server does.
"""
