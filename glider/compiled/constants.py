"""Numbers that the compiled loops share."""

DIFFERENCE = 1e-6
"""Step of the finite differences, in a coefficient's own scale."""

TINY = 1e-30
"""Length of the complex steps."""

BLOCK = 32
"""Number of gliders that fly side by side, so that one instruction serves several."""
