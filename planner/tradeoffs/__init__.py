"""What a motion's limits and its objective cost: seconds saved by each limit, and time against heat."""
