"""Our messages in MCAP: a writer that survives its process and a reader that never guesses."""
