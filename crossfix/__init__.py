"""crossfix: carriers that disagree about their frames, and a fusion centre that makes them agree."""
