"""RS-274, the language of G-code: words, expressions, O-words, offsets, and what a controller makes
of them.
"""
