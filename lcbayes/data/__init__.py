"""Light curves: the class, its readers and writers, the Earth's shadow, segments."""
