"""The processor as TI documents it: its number formats and arithmetic."""
