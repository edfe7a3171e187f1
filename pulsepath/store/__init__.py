"""The folder of a plan: written completely or not at all, read back, and verified."""
