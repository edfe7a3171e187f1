"""Numbers that others published, beside ours."""
