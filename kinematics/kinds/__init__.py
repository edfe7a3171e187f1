"""The files of each kind of machine: the schema of its TOML, and what makes the machine of a valid
one.
"""
