"""What shows the claims of the README and the docs, as commands; not part of what is installed."""
