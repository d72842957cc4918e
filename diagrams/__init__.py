"""Functions that wire the library's systems into Drake diagrams."""
