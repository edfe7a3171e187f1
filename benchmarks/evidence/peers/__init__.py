"""Problems, our solvers, and one adapter for each peer, which loads it where it is installed."""
