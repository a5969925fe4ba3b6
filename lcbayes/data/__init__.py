"""Light curves: the type, its readers and writers, the Earth's shadow, segments."""
