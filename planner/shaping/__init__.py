"""Motions behind input shapers: what the axes do, what is proved of that, and how far it is from
the path.
"""
