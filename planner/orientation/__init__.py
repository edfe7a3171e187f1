"""Orientation where a program leaves it free."""
