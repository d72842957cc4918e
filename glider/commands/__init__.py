"""The commands of `python -m glider`: what each takes, and what it does."""
