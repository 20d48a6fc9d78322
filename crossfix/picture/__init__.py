"""A recording as a picture: figures for people and programs, and a page that needs no network."""
