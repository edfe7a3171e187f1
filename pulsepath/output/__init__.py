"""What commands leave behind: directories, records, tables."""
