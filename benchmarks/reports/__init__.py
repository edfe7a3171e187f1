"""Reports: self-contained HTML pages of plans, calibrations and comparisons."""
