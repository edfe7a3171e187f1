"""Programs: segments and joins, the files that state them, and formulas in them."""
