"""What motors do so that play and screw errors do not show."""
