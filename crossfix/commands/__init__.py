"""The verbs of the command line, one a module; `crossfix.__main__` lists them."""

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where processes that are started by hand meet, unless told otherwise."""
