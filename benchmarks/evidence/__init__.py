"""Measurements from which every published figure comes.

They are not installed with the packages.
"""
