"""Files in and out: TOML with its lines, schemas, text, results that are there whole or not at
all.
"""
