"""The fusion centre as a process: who takes part, what has come, when an instant is over."""
