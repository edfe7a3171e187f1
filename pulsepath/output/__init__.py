"""Output of the commands: directories, records, tables."""
