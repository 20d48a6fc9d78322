"""The verbs of the command line, one a module; `crossfix.__main__` lists them."""
