"""Programs from elsewhere: a file for each format."""
