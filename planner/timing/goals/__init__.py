"""Goals of a motion: fastest, constant speed, stated duration, time and heat."""
