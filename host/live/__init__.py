"""The operator's page: curves, attitude and state of a board in a browser, while it is recorded or from a log."""
