"""Studies: questions about the navigator that a command answers with figures and tables, the same ones each time."""
