"""The search for effects that explain the flights; `tracing` and `signs` start it."""
