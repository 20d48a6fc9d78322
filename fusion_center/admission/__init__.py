"""Who takes part, what of theirs is let in, how it is counted: for fusion and recorder alike."""
