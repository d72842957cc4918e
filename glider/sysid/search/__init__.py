"""The search for effects that explain the flights.

signs: angles logged with the other sign. tracing, force_search: the two searches, with
and without known forces. subsets, fits: sets scored and fitted. moves: other sets.
fields: unmodelled residuals. support: bootstrap inclusion and rivals.
"""
