"""The fusion centre as a process: who is here, what has come, when an instant is over."""
