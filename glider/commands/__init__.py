"""The commands of `glider`: what each takes, and what it does."""
