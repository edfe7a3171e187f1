"""A certified motion interrupted: stopped along its path, gone on with, and run slower."""
