"""What every floor shares: arrays, errors, names, units, tables, figures, guaranteed arithmetic."""
