"""The processes of the command line: signals, exits, the second core."""
