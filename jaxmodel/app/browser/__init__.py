"""The workbench in a browser: a server of pages, and a process of its own for the work of each session.

The server (`server`, `page`, `security`) never imports the model, so that it starts at once;
`jaxmodel.app.browser.worker` does all work and leaves its results as files in the session's folder, which pages show.
"""
