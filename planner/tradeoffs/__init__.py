"""The worth of each limit, in seconds, and the objective: time, or time and heat."""
