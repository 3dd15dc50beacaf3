"""The kernel language: one source, a front end, and a lowering per machine."""
